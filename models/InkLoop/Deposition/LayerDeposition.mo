within InkLoop.Deposition;
block LayerDeposition "Layer-to-layer height map with one or two materials (Lu, Zheng, Mishra 2015)"
  extends Interfaces.PartialDeposition;

  parameter Types.Ink ink_a "Material A";
  parameter Types.Ink ink_b "Material B";
  parameter Integer passes(min=1, max=4) = 1 "Passes of a layer, 1 or 4, with cure between them";
  parameter Types.PassOrder pass_order = Types.PassOrder.raster "Order of the four passes";
  parameter Integer pass_rotation(min=0, max=3) = 0 "Places by which the order of the passes moves from layer to layer";
  parameter Types.Share variation = 0 "Amplitude p of the volume factor 1 - U[0, p]";
  parameter Types.VariationKind variation_kind = Types.VariationKind.per_droplet "Scope of one volume factor";
  parameter Integer nozzle_pitch(min=1) = 1 "Number of nozzles; the head travels along x";
  parameter Types.Share nozzle_variation = 0 "Amplitude of the volume factor of a nozzle";
  parameter Integer seed(min=0) = 0 "Seed of all random factors";

  Types.Volume volume_lost = lost*pitch^2 "Ink that left the grid over its open edges, height times cell area";

protected
  discrete Types.Height lost(start=0, fixed=true) "Sum of the heights that have left the grid";

initial equation
  assert(passes == 1 or passes == 4, "passes is neither 1 nor 4; a layer is printed in one pass or in four");

algorithm
  when completed then
    (height, lost) := Functions.printLayer(pre(height), pre(captured),
      Functions.volumeFactors(nx, ny, pre(reference), seed, variation, variation_kind, nozzle_pitch, nozzle_variation),
      ink_a, ink_b, pre(reference), passes, pass_order, pass_rotation, pre(lost));
  end when;

  annotation (
    defaultComponentName="deposition",
    Documentation(info="<html>
<p>
The surface of a print after each layer of droplets. One droplet with heights h1, h2, h3 falls on cell p. For each of its eight
neighbours q, with a = h2 (side) or h3 (corner),
</p>
<blockquote><p>
s = clip(1 + (H<sub>p</sub> - H<sub>q</sub>)/(h1 + a), 0, 1),&nbsp; q receives a s,&nbsp; p gets back a (1 - s),
</p></blockquote>
<p>
and p receives h1 itself. All H are the heights before the pass; the shares of all droplets add up. Therefore an interior droplet always adds
h1 + 4 h2 + 4 h3.
</p>
<h4>Assumptions</h4>
<ul>
<li>A neighbour outside the grid is an open edge: it takes its full share, which counts in <code>volume_lost</code>.</li>
<li>With two materials, heights and saturation width are those of the droplet that falls.</li>
<li><code>passes</code> = 4 prints a layer in a 2 x 2 colouring, cured in between.</li>
<li>The heights are the model's own units: peak heights of measured caps, which must not be read as volumes.</li>
</ul>
<p>The FMU of the same name also has grey droplets, a roller and a volume factor as an input.</p>
<h4>References</h4>
<p><a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>, equations (2) to (7) and Table I.</p>
</html>"));
end LayerDeposition;

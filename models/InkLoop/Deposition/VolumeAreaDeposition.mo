within InkLoop.Deposition;
block VolumeAreaDeposition "Propagation of the volume and area of ink, drop by drop (Wu, Chiu 2024)"
  extends Interfaces.PartialDeposition(pitch=90e-6);

  parameter Types.Height height_scale = 7.0751e-6 "Volume of a drop over the area of a cell";
  parameter Types.InverseLength mv_plus = 6700 "Share of a drop that a neighbour gains per height above its surroundings";
  parameter Types.InverseLength mv_minus = -20100 "Share of a drop that a neighbour gains per height below them, negative";
  parameter Types.InverseLength ma_plus = 0 "Share of its area that a neighbour gains per height above its surroundings";
  parameter Types.InverseLength ma_minus = -63400 "Share of its area that a neighbour gains per height below them, negative";
  parameter Types.Length cap_radius = 0.6*pitch "Base radius of a drop on flat ground";
  parameter Boolean guard = false "= true, if a partly covered higher cell grows its area at constant height";
  parameter Types.Share variation = 0 "Amplitude p of the volume factor 1 - U[0, p]";
  parameter Types.VariationKind variation_kind = Types.VariationKind.per_droplet "Scope of one volume factor";
  parameter Integer nozzle_pitch(min=1) = 1 "Number of nozzles; the head travels along x";
  parameter Types.Share nozzle_variation = 0 "Amplitude of the volume factor of a nozzle";
  parameter Integer seed(min=0) = 0 "Seed of all random factors";

  discrete Types.Share area[nx, ny](each start=0, each fixed=true) "Covered share of each cell";

protected
  parameter Types.Share cap[2, 3] = Functions.capShares(height_scale, cap_radius, pitch) "Volume and covered shares on flat ground: middle, side, corner";

algorithm
  when completed then
    (height, area) := Functions.volumeAreaLayer(pre(height), pre(area), height_start, pre(captured),
      Functions.volumeFactors(nx, ny, pre(reference), seed, variation, variation_kind, nozzle_pitch, nozzle_variation),
      height_scale, {mv_plus, mv_minus, ma_plus, ma_minus}, cap, guard);
  end when;

  annotation (
    defaultComponentName="deposition",
    Documentation(info="<html>
<p>
State of a cell: v, the ink in it as a share of one drop, and a, the share of the cell that ink covers. The height of the covered part
is h = c v/a. A drop on cell p acts on the 3 x 3 cells around p. With the difference h~ of each cell's height and the mean of the
cells that touch it inside this region, before the drop, every cell q but p takes
</p>
<blockquote><p>
dv = m<sub>v</sub>+ h~ where h~ &gt; 0, m<sub>v</sub>- h~ where h~ &lt; 0;&nbsp;
da = m<sub>a</sub>+ h~ where h~ &gt; 0, m<sub>a</sub>- h~ where h~ &lt; 0, a at most 1,
</p></blockquote>
<p>and p keeps the rest of the drop and is covered. On flat ground a drop is a spherical cap.</p>
<h4>Assumptions</h4>
<ul>
<li><code>height</code> is the mean over each cell, <code>height_start</code> + c v: the sum of all heights times the area of a cell is the volume
of the ink.</li>
<li>The pitch and the cap: with a base radius of 0.6 pitch the published differences (19) are reproduced to 0.18 um; the range printed in the
text (1.5 to 2 pitches) misses them by 3 um.</li>
<li>Nothing leaves the grid: ink that would lie outside stays with the cell that is hit.</li>
<li>Both materials have the same properties and are counted separately. Drops fall along y first; only the FMU has <code>passes</code> and other orders.</li>
</ul>
<h4>References</h4>
<p><a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>, equations (1) to (20).</p>
</html>"));
end VolumeAreaDeposition;

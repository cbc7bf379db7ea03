within InkLoop.Functions;
pure function printLayer "Surface after one layer, in one pass or in four"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface before the layer";
  input Types.Pattern pattern[size(height, 1), size(height, 2)] "Pattern to jet";
  input Types.VolumeFactor factor[size(height, 1), size(height, 2)] "Volumes of the droplets";
  input Types.Ink ink_a "Material A";
  input Types.Ink ink_b "Material B";
  input Integer layer "Number of the layer, from 1";
  input Integer passes "Passes of a layer, 1 or 4";
  input Types.PassOrder pass_order "Order of the four passes";
  input Integer pass_rotation "Places by which the order moves from layer to layer";
  input Types.Height lostBefore "Heights that have left the grid before";
  output Types.Height after[size(height, 1), size(height, 2)] "Surface after the layer";
  output Types.Height lost "Sum of the heights that have left the grid";

algorithm
  after := height;
  lost := lostBefore;
  if passes == 1 then
    (after, lost) := layerMap(height, pattern, factor, ink_a, ink_b, lostBefore);
  else
    for pass in 0:3 loop
      (after, lost) := layerMap(after, ofColour(pattern, passColour(pass, layer, pass_order, pass_rotation)),
        factor, ink_a, ink_b, lost);
    end for;
  end if;

  annotation (Documentation(info="<html>
<p>
One pass is one <a href=\"modelica://InkLoop.Functions.layerMap\">layerMap</a>. In four passes a 2 x 2 colouring is printed colour by colour,
cured in between: each pass acts on the surface that the last one left (section V-D of
<a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>).
</p>
</html>"));
end printLayer;

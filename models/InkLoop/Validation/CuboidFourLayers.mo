within InkLoop.Validation;
model CuboidFourLayers "Middle row and corner of a cuboid of 9 x 9 cells after four layers"
  extends Icons.Example;

  parameter Types.Height middle[5] = {27.343e-6, 29.592e-6, 30.273e-6, 30.391e-6, 30.400e-6} "Middle row, from the edge to the centre";
  parameter Types.Height corner = 24.536e-6 "Corner";
  parameter Types.Height rounding = 0.0006e-6 "The numbers are rounded to 0.001 um";

  Control.PatternSequence controller(patterns=fill(1, 4, 9, 9)) "Four full layers"
    annotation (Placement(transformation(extent={{-60,-20},{-20,20}})));
  Deposition.LayerDeposition deposition "Prints them"
    annotation (Placement(transformation(extent={{20,-20},{60,20}})));

equation
  connect(controller.pattern, deposition.pattern)
    annotation (Line(points={{-18,12},{16,12}}, color={255,127,0}));
  connect(controller.layer_command, deposition.layer_command)
    annotation (Line(points={{-18,-12},{16,-12}}, color={255,127,0}));

  when deposition.layers_printed >= 4 then
    assert(max(abs(deposition.height[5, 1:5] - middle)) < rounding, "the middle row is not 27.343 29.592 30.273 30.391 30.400 um");
    assert(abs(deposition.height[1, 1] - corner) < rounding, "the corner is not 24.536 um");
    assert(max(abs(deposition.height[5, 1:9] - deposition.height[1:9, 5])) < 1e-15, "the cuboid is not symmetric");
    assert(deposition.droplets_a == 324 and deposition.droplets_b == 0, "324 droplets of material A were jetted, none of B");
  end when;

  annotation (
    experiment(StopTime=5, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
Section III-C of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a> with the heights of Table I. After M layers the edge has affected
M cells, so after four layers only the centre of nine cells is still at 4 (h1 + 4 h2 + 4 h3) = 30.4 um.
</p>
</html>"));
end CuboidFourLayers;

within InkLoop.Validation;
model LineOfCells "A line of cells: two layers in closed form"
  extends Icons.Example;

  parameter Integer n = 7 "Cells of the line";
  parameter Types.Height h1 = 4.4e-6 "Height on the cell that is hit";
  parameter Types.Height h2 = 0.6e-6 "Height on a side neighbour";
  parameter Types.Height r = h1*h2/(h1 + h2) "Flow back from the second cell's edge side";
  parameter Types.Height rounding = 1e-18 "Rounding of Real numbers";

  Control.PatternSequence controller(patterns=fill(1, 2, n, 1)) "Two full layers"
    annotation (Placement(transformation(extent={{-60,-20},{-20,20}})));
  Deposition.LayerDeposition deposition(nx=n, ny=1, ink_a(h1=h1, h2=h2, h3=0)) "Prints them"
    annotation (Placement(transformation(extent={{20,-20},{60,20}})));

equation
  connect(controller.pattern, deposition.pattern)
    annotation (Line(points={{-18,12},{16,12}}, color={255,127,0}));
  connect(controller.layer_command, deposition.layer_command)
    annotation (Line(points={{-18,-12},{16,-12}}, color={255,127,0}));

  when deposition.layers_printed >= 1 then
    assert(abs(deposition.height[1, 1] - (h1 + h2)) < rounding, "layer 1: the edge is not h1 + h2");
    assert(abs(deposition.height[2, 1] - (h1 + 2*h2)) < rounding, "layer 1: the second cell is not h1 + 2 h2");
    assert(abs(deposition.height[4, 1] - (h1 + 2*h2)) < rounding, "layer 1: the middle is not h1 + 2 h2");
  end when;
  when deposition.layers_printed >= 2 then
    assert(abs(deposition.height[1, 1] - (2*h1 + 3*h2 - r)) < rounding, "layer 2: the edge is not 2 h1 + 3 h2 - r");
    assert(abs(deposition.height[2, 1] - (2*h1 + 3*h2 + r)) < rounding, "layer 2: the second cell is not 2 h1 + 3 h2 + r");
    assert(abs(deposition.height[4, 1] - (2*h1 + 4*h2)) < rounding, "layer 2: the middle is not 2 h1 + 4 h2");
  end when;

  annotation (
    experiment(StopTime=3, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
Section III-C of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>, a line of cells with h3 = 0. Layer 1: the edge is h1 + h2, the others
h1 + 2 h2. Layer 2, with r = h1 h2/(h1 + h2): the edge is 2 h1 + 3 h2 - r, its neighbour 2 h1 + 3 h2 + r, the others 2 h1 + 4 h2.
</p>
</html>"));
end LineOfCells;

within InkLoop.Validation;
model VolumeAreaBalance "Propagation of volume and area: every drop adds its volume"
  extends Icons.Example;

  Types.Height present = sum(deposition.height) "Ink on the grid";
  Types.Height jetted = deposition.droplets_a*deposition.height_scale "Sum of all drops";

  Control.PatternSequence controller(patterns={{{if mod(i*j + k, 3) > 0 then 1 else 0 for j in 1:5} for i in 1:5} for k in 1:3}) "Three layers"
    annotation (Placement(transformation(extent={{-60,-20},{-20,20}})));
  Deposition.VolumeAreaDeposition deposition(nx=5, ny=5) "Prints them"
    annotation (Placement(transformation(extent={{20,-20},{60,20}})));

equation
  connect(controller.pattern, deposition.pattern)
    annotation (Line(points={{-18,12},{16,12}}, color={255,127,0}));
  connect(controller.layer_command, deposition.layer_command)
    annotation (Line(points={{-18,-12},{16,-12}}, color={255,127,0}));

  assert(abs(present - jetted) <= 1e-12*jetted, "the drops on the grid do not add up to what was jetted");
  assert(min(deposition.area) >= 0 and max(deposition.area) <= 1, "a cell is covered by less than nothing or by more than all of it");

  when deposition.layers_printed >= 3 then
    assert(max(deposition.area) >= 1, "no cell is covered, although drops fell on it");
  end when;

  annotation (
    experiment(StopTime=4, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>Equation (12) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>: the cell that is hit keeps everything that its neighbours do not take.</p>
</html>"));
end VolumeAreaBalance;

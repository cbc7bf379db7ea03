within InkLoop.Examples.BaseClasses;
partial model PrintLoop "Controller, deposition and sensor in a loop"
  parameter Integer nx(min=1) = 9 "Cells along x";
  parameter Integer ny(min=1) = 9 "Cells along y";

  replaceable Control.OpenLoop controller(nx=nx, ny=ny) constrainedby Interfaces.PartialController(nx=nx, ny=ny) "Chooses the patterns"
    annotation (Placement(transformation(extent={{-80,-20},{-40,20}})));
  replaceable Deposition.LayerDeposition deposition(nx=nx, ny=ny) constrainedby Interfaces.PartialDeposition(nx=nx, ny=ny) "Prints"
    annotation (Placement(transformation(extent={{-20,-20},{20,20}})));
  replaceable Sensors.ProfileSensor sensor(nx=nx, ny=ny) constrainedby Interfaces.PartialSensor(nx=nx, ny=ny) "Measures"
    annotation (Placement(transformation(extent={{40,-20},{80,20}})));

equation
  connect(controller.pattern, deposition.pattern)
    annotation (Line(points={{-38,12},{-24,12}}, color={255,127,0}));
  connect(controller.layer_command, deposition.layer_command)
    annotation (Line(points={{-38,0},{-32,0},{-32,-12},{-24,-12}}, color={255,127,0}));
  connect(deposition.height, sensor.height)
    annotation (Line(points={{22,12},{36,12}}, color={0,0,127}));
  connect(deposition.layers_printed, sensor.layers_printed)
    annotation (Line(points={{22,0},{28,0},{28,-12},{36,-12}}, color={255,127,0}));
  connect(deposition.layers_printed, controller.layers_printed)
    annotation (Line(points={{22,0},{28,0},{28,-40},{-94,-40},{-94,-16},{-84,-16}}, color={255,127,0}));
  connect(sensor.measured_height, controller.measured_height)
    annotation (Line(points={{82,14},{96,14},{96,50},{-96,50},{-96,16},{-84,16}}, color={0,0,127}));
  connect(sensor.valid, controller.valid)
    annotation (Line(points={{82,6},{92,6},{92,46},{-92,46},{-92,6},{-84,6}}, color={255,0,255}));
  connect(sensor.layers_scanned, controller.layers_scanned)
    annotation (Line(points={{82,-6},{90,-6},{90,-50},{-98,-50},{-98,-6},{-84,-6}}, color={255,127,0}));

  annotation (Documentation(info="<html>
<p>
The loop of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>. Each of the three components can be replaced.
</p>
</html>"));
end PrintLoop;

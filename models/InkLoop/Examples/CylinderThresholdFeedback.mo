within InkLoop.Examples;
model CylinderThresholdFeedback "The same cylinder with threshold feedback"
  extends Icons.Example;
  extends BaseClasses.PrintLoop(
    nx=11,
    ny=11,
    redeclare Control.ThresholdFeedback controller(
      nx=nx,
      ny=ny,
      material=Functions.cylinder(nx, ny, 4),
      target_height=45.6e-6*Functions.cylinder(nx, ny, 4)),
    redeclare Deposition.LayerDeposition deposition(
      nx=nx,
      ny=ny,
      nozzle_pitch=5,
      nozzle_variation=0.4,
      seed=1),
    redeclare Sensors.ProfileSensor sensor(
      nx=nx,
      ny=ny,
      scan_duration=1,
      resolution=0.1e-6));

  annotation (
    experiment(StopTime=14, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
The plant of <a href=\"modelica://InkLoop.Examples.CylinderOpenLoop\">CylinderOpenLoop</a>, and a droplet only where at least half a layer is missing to
45.6 um, six nominal layers. The stripes are gone: weak nozzles jet more often. The print ends by itself when no cell needs a
droplet; <code>controller.status</code> is done from then on.
</p>
</html>"));
end CylinderThresholdFeedback;

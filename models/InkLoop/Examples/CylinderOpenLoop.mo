within InkLoop.Examples;
model CylinderOpenLoop "A cylinder in open loop, with nozzles that lack volume"
  extends Icons.Example;
  extends BaseClasses.PrintLoop(
    nx=11,
    ny=11,
    redeclare Control.OpenLoop controller(
      nx=nx,
      ny=ny,
      layers_max=6,
      material=Functions.cylinder(nx, ny, 4)),
    redeclare Deposition.LayerDeposition deposition(
      nx=nx,
      ny=ny,
      nozzle_pitch=5,
      nozzle_variation=0.4,
      seed=1),
    sensor(scan_duration=1));

  annotation (
    experiment(StopTime=8, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
Six full layers of a cylinder that is 9 cells wide. Five nozzles jet it, and each lacks up to 40 % of its droplets' volume, the same
in every layer: stripes along x grow with every layer. Plot <code>deposition.height[6, 2]</code> to <code>[6, 10]</code> at the end, and compare with
<a href=\"modelica://InkLoop.Examples.CylinderThresholdFeedback\">CylinderThresholdFeedback</a>.
</p>
</html>"));
end CylinderOpenLoop;

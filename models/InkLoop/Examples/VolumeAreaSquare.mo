within InkLoop.Examples;
model VolumeAreaSquare "Two layers of a square by propagation of volume and area"
  extends Icons.Example;
  extends BaseClasses.PrintLoop(
    redeclare Deposition.VolumeAreaDeposition deposition(
      nx=nx,
      ny=ny,
      guard=true),
    redeclare Control.OpenLoop controller(
      nx=nx,
      ny=ny,
      layers_max=2,
      material=Functions.cuboid(nx, ny, 2)),
    redeclare Sensors.ProfileSensor sensor(
      nx=nx,
      ny=ny,
      pitch=90e-6,
      scan_duration=1));

  annotation (
    experiment(StopTime=4, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
Two layers of 5 x 5 drops, one drop after the other. Plot <code>deposition.height[5, 3]</code> to <code>[5, 7]</code> and <code>deposition.area[5, 2]</code>: the
cell next to the part is partly covered.
</p>
</html>"));
end VolumeAreaSquare;

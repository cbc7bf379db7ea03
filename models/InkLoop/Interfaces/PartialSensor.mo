within InkLoop.Interfaces;
partial block PartialSensor "Scans the surface after each layer"
  extends Icons.Sensor;

  parameter Integer nx(min=1) = 9 "Cells along x";
  parameter Integer ny(min=1) = 9 "Cells along y";
  parameter Types.Duration scan_duration = 6 "Time from the beginning of a scan to its result";

  HeightInput height[nx, ny] "Surface after the completed layers"
    annotation (Placement(transformation(extent={{-140,40},{-100,80}})));
  LayerInput layers_printed "Layers completed; each new number is scanned once"
    annotation (Placement(transformation(extent={{-140,-80},{-100,-40}})));
  HeightOutput measured_height[nx, ny](each start=0, each fixed=true) "The last finished scan"
    annotation (Placement(transformation(extent={{100,60},{120,80}})));
  BooleanOutput valid[nx, ny](each start=false, each fixed=true) "= true, if the last finished scan has measured the cell"
    annotation (Placement(transformation(extent={{100,20},{120,40}})));
  LayerOutput layers_scanned(start=-1, fixed=true) "The layer that the last finished scan belongs to, -1 before the first"
    annotation (Placement(transformation(extent={{100,-40},{120,-20}})));
  StatusOutput status(start=Types.Status.idle, fixed=true) "idle or busy"
    annotation (Placement(transformation(extent={{100,-80},{120,-60}})));

protected
  Boolean begun "= true, if a layer waits for its scan and the sensor is idle";
  Boolean finished "= true, if the scan in progress is finished";
  discrete Types.Height captured[nx, ny](each start=0, each fixed=true) "Surface when the scan began";
  Types.Layer layerCaptured(start=-1, fixed=true) "Layer that is or was scanned last";
  Integer scans(start=0, fixed=true) "Finished scans";
  discrete Types.Duration readyAt(start=0, fixed=true) "Time at which the scan is finished";

equation
  begun = pre(status) == Types.Status.idle and layers_printed <> pre(layerCaptured);
  finished = pre(status) == Types.Status.busy and time >= pre(readyAt);

algorithm
  when {initial(), begun} then
    captured := height;
    layerCaptured := layers_printed;
    readyAt := time + scan_duration;
    status := Types.Status.busy;
  elsewhen finished then
    layers_scanned := pre(layerCaptured);
    scans := pre(scans) + 1;
    status := Types.Status.idle;
  end when;

  annotation (Documentation(info="<html>
<p>
The sensor's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>. A sensor extends it and states what
<code>measured_height</code> and <code>valid</code> become <code>when finished</code>, from <code>pre(captured)</code>.
</p>
<h4>Assumptions</h4>
<ul>
<li>The first scan begins with the simulation and is of layer 0, the start surface.</li>
<li>A scan takes the surface at the moment in which it begins, and the newest layer: the number may jump.</li>
</ul>
</html>"));
end PartialSensor;

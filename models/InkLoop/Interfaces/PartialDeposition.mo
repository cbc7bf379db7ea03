within InkLoop.Interfaces;
partial block PartialDeposition "Takes commands and patterns, prints layers"
  extends Icons.Deposition;

  parameter Integer nx(min=1) = 9 "Cells along x";
  parameter Integer ny(min=1) = 9 "Cells along y";
  parameter Types.Length pitch = 263.256e-6 "Distance of neighbouring cells";
  parameter Types.Height height_start[nx, ny] = zeros(nx, ny) "Surface before the first layer";
  parameter Types.Duration layer_duration = 0 "Time from a command to the completed layer";

  PatternInput pattern[nx, ny] "Pattern of the next commanded layer"
    annotation (Placement(transformation(extent={{-140,40},{-100,80}})));
  LayerInput layer_command "One more than before: print one layer with the present pattern"
    annotation (Placement(transformation(extent={{-140,-80},{-100,-40}})));
  HeightOutput height[nx, ny](start=height_start, each fixed=true) "Surface after the completed layers"
    annotation (Placement(transformation(extent={{100,50},{120,70}})));
  LayerOutput layers_printed(start=0, fixed=true) "Layers completed (jetted and cured)"
    annotation (Placement(transformation(extent={{100,-10},{120,10}})));
  StatusOutput status(start=Types.Status.idle, fixed=true) "idle or busy"
    annotation (Placement(transformation(extent={{100,-70},{120,-50}})));

  Types.Height height_mean = sum(height)/(nx*ny) "Mean height over the whole grid";
  Integer droplets_a(start=0, fixed=true) "Droplets of material A in all completed layers";
  Integer droplets_b(start=0, fixed=true) "Droplets of material B in all completed layers";

protected
  Boolean commanded "= true, if a received command has not been taken";
  Boolean completed "= true, if the layer being printed is complete";
  Boolean inOrder(start=true, fixed=true) "= true, if the command taken last was one more than the one before";
  Boolean known(start=true, fixed=true) "= true, if the pattern taken last holds materials only";
  Types.Layer reference(start=0, fixed=true) "Command taken last";
  Types.Pattern captured[nx, ny](each start=0, each fixed=true) "Pattern of the layer being printed";
  discrete Types.Duration readyAt(start=0, fixed=true) "Time at which the layer is complete";

equation
  commanded = pre(layer_command) <> pre(reference);
  completed = pre(status) == Types.Status.busy and time >= pre(readyAt);

  assert(inOrder, "layer_command is out of order; expected one more than layers_printed, while status is idle");
  assert(known, "pattern has a value that is no material; expected 0 (none), 1 (A) or 2 (B)");

algorithm
  when commanded then
    inOrder := pre(layer_command) == pre(reference) + 1 and pre(status) == Types.Status.idle;
    known := min(pre(pattern)) >= 0 and max(pre(pattern)) <= 2;
    reference := pre(layer_command);
    captured := pre(pattern);
    readyAt := time + layer_duration;
    status := Types.Status.busy;
  elsewhen completed then
    layers_printed := pre(layers_printed) + 1;
    droplets_a := pre(droplets_a) + Functions.countCells(pre(captured), 1);
    droplets_b := pre(droplets_b) + Functions.countCells(pre(captured), 2);
    status := Types.Status.idle;
  end when;

  annotation (Documentation(info="<html>
<p>
The deposition's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>. A model of deposition extends it
and states what <code>height</code> becomes <code>when completed</code>.
</p>
<h4>Assumptions</h4>
<ul>
<li>The pattern is taken when the command is accepted; later changes of the input have no effect.</li>
<li>A command out of order stops the simulation with a message.</li>
<li>Commands and patterns are read with <code>pre</code>, one event iteration after they were given. This is the only place where the
loop of controller, deposition and sensor is broken, so that its equations can be sorted.</li>
</ul>
</html>"));
end PartialDeposition;

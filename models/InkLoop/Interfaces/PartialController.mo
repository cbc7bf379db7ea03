within InkLoop.Interfaces;
partial block PartialController "Chooses the next pattern after each scan"
  extends Icons.Controller;

  parameter Integer nx(min=1) = 9 "Cells along x";
  parameter Integer ny(min=1) = 9 "Cells along y";
  parameter Integer layers_max(min=0) = 1000 "Layers after which the print ends in any case";

  HeightInput measured_height[nx, ny] "The last finished scan"
    annotation (Placement(transformation(extent={{-140,60},{-100,100}})));
  BooleanInput valid[nx, ny] "= true, if the last finished scan has measured the cell"
    annotation (Placement(transformation(extent={{-140,10},{-100,50}})));
  LayerInput layers_scanned(start=-1) "The layer that the last finished scan belongs to"
    annotation (Placement(transformation(extent={{-140,-50},{-100,-10}})));
  LayerInput layers_printed "Layers completed"
    annotation (Placement(transformation(extent={{-140,-100},{-100,-60}})));
  PatternOutput pattern[nx, ny](each start=0, each fixed=true) "Pattern of the last commanded layer"
    annotation (Placement(transformation(extent={{100,50},{120,70}})));
  LayerOutput layer_command(start=0, fixed=true) "Layers commanded"
    annotation (Placement(transformation(extent={{100,-10},{120,10}})));
  StatusOutput status(start=Types.Status.idle, fixed=true) "idle, or done: the print is finished"
    annotation (Placement(transformation(extent={{100,-70},{120,-50}})));

protected
  Boolean asked "= true, if the newest layer has been scanned and no command is in progress";
  Types.Pattern next[nx, ny] "Pattern that would be jetted next; none ends the print";
  Boolean enough = layers_scanned >= layers_max or max(next) == 0 "= true, if nothing is left to print";

equation
  asked = layers_scanned == layers_printed and pre(layer_command) == layers_scanned;

algorithm
  when asked then
    pattern := if enough then fill(0, nx, ny) else next;
    layer_command := if enough then pre(layer_command) else pre(layer_command) + 1;
    status := if enough then Types.Status.done else Types.Status.idle;
  end when;

  annotation (Documentation(info="<html>
<p>
The controller's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>. A controller extends it and states
<code>next</code>, the pattern for the measured surface. An empty pattern ends the print.
</p>
<h4>Assumptions</h4>
<ul>
<li>One command for each scan, and only when the newest layer has been scanned.</li>
<li>The controller computes in zero time.</li>
</ul>
</html>"));
end PartialController;

within InkLoop.Control;
block PatternSequence "Given patterns, one per period"
  extends Icons.Controller;

  parameter Types.Pattern patterns[:, :, :] = fill(1, 1, 9, 9) "Patterns, the first index counts layers";
  parameter Types.Duration period(min=1e-6) = 1 "Time from layer to layer";

  Interfaces.PatternOutput pattern[size(patterns, 2), size(patterns, 3)](each start=0, each fixed=true) "Pattern of the last commanded layer"
    annotation (Placement(transformation(extent={{100,50},{120,70}})));
  Interfaces.LayerOutput layer_command(start=0, fixed=true) "Layers commanded"
    annotation (Placement(transformation(extent={{100,-70},{120,-50}})));

algorithm
  when sample(period, period) then
    pattern := patterns[min(size(patterns, 1), pre(layer_command) + 1), :, :];
    layer_command := min(size(patterns, 1), pre(layer_command) + 1);
  end when;

  annotation (
    defaultComponentName="controller",
    Documentation(info="<html>
<p>Needs no sensor. It commands nothing after the last pattern.</p>
<h4>Assumptions</h4>
<ul>
<li>The period is longer than the deposition's <code>layer_duration</code>.</li>
</ul>
</html>"));
end PatternSequence;

within InkLoop.UsersGuide;
class LayerContract "Layer contract"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<p>
Layer-to-layer printing is a discrete process. Controller, deposition and sensor act on sequence numbers, so that no component relies on
an order or a step size.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"4\">
<tr><th>signal</th><th>from</th><th>meaning</th></tr>
<tr><td><code>pattern</code></td><td>controller</td><td>what to jet in the next commanded layer: 0 none, 1 material A, 2 material B</td></tr>
<tr><td><code>layer_command</code></td><td>controller</td><td>same value: no action; one more while idle: print one layer with the present pattern; anything else stops
the simulation</td></tr>
<tr><td><code>layers_printed</code></td><td>deposition</td><td>layers completed, <code>layer_duration</code> after the command</td></tr>
<tr><td><code>height</code></td><td>deposition</td><td>surface after the completed layers</td></tr>
<tr><td><code>measured_height</code>, <code>valid</code></td><td>sensor</td><td>the last finished scan and its valid cells</td></tr>
<tr><td><code>layers_scanned</code></td><td>sensor</td><td>the layer of that scan, <code>scan_duration</code> after <code>layers_printed</code> rose; -1 before the first,
which is of layer 0, the start surface</td></tr>
<tr><td><code>status</code></td><td>each</td><td>idle, busy, done (controller: print finished)</td></tr>
</table>
<ol>
<li>The controller commands layer k + 1 only when <code>layers_printed</code> = <code>layers_scanned</code> = k, once per scan.</li>
<li>The pattern is taken when the command is accepted. Later changes of the input have no effect.</li>
<li>A scan takes the newest layer when it begins; the number may jump.</li>
<li>In a loop <code>layer_duration</code> or <code>scan_duration</code> must be above 0: otherwise the whole print would be one instant, and its event
iteration would not end.</li>
</ol>
<p>
To replace one of the three, extend <a href=\"modelica://InkLoop.Interfaces.PartialDeposition\">PartialDeposition</a>,
<a href=\"modelica://InkLoop.Interfaces.PartialSensor\">PartialSensor</a> or
<a href=\"modelica://InkLoop.Interfaces.PartialController\">PartialController</a>, which implement the rules.
</p>
</html>"));
end LayerContract;

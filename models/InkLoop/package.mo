within ;
package InkLoop "Closed-loop ink-jet 3D printing, layer by layer"
  extends Icons.Package;

  annotation (
    version="0.2.0",
    versionBuild=1,
    versionDate="2026-11-28",
    dateModified="2026-11-28 01:00:00Z",
    conversion(from(version="0.1.0", to="0.2.0", change={
      convertElement("InkLoop.Control.ThresholdFeedback", "layer_height", "layerHeight"),
      convertElement({"InkLoop.Functions.capHeight", "InkLoop.Functions.capOverRectangle"}, "base_radius", "baseRadius"),
      convertElement("InkLoop.Functions.capOverRectangle", "cap_height", "apex")})),
    preferredView="info",
    Documentation(info="<html>
<p>
Models of closed-loop ink-jet 3D printing: a part is built layer by layer from droplets, its surface is measured after
every layer, and the next pattern of droplets is chosen from the measurement.
</p>
<table border=\"1\" cellspacing=\"0\" cellpadding=\"4\">
<tr><td><a href=\"modelica://InkLoop.UsersGuide\">UsersGuide</a></td><td>conventions, the layer contract, references</td></tr>
<tr><td><a href=\"modelica://InkLoop.Examples\">Examples</a></td><td>prints in open and closed loop</td></tr>
<tr><td><a href=\"modelica://InkLoop.Deposition\">Deposition</a></td><td>the surface after a layer of droplets</td></tr>
<tr><td><a href=\"modelica://InkLoop.Sensors\">Sensors</a></td><td>the surface as an instrument measures it</td></tr>
<tr><td><a href=\"modelica://InkLoop.Control\">Control</a></td><td>the droplets of the next layer</td></tr>
<tr><td><a href=\"modelica://InkLoop.Validation\">Validation</a></td><td>published numbers and invariants, as assertions</td></tr>
</table>
<p>
The library states in readable form the models that the project inkloop ships as FMUs; tests check that both give the same
numbers. It is plain Modelica 3.6, uses no other library and calls no external code.
</p>
</html>"),
    Icon(graphics={
      Rectangle(extent={{-70,-70},{70,-50}}, lineColor={0,0,0}, fillColor={160,160,164}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-50,-50},{50,-30}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-50,-30},{20,-10}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Ellipse(extent={{25,10},{45,30}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{15,45},{55,70}}, lineColor={0,0,0}, fillColor={215,215,215}, fillPattern=FillPattern.Solid)}));
end InkLoop;

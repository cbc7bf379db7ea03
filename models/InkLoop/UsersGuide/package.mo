within InkLoop;
package UsersGuide "User's guide"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<p>
Ink-jet 3D printing builds a part layer by layer from droplets. Printed in open loop, tops become domes, edges shrink and heights
drift. In closed loop the surface is measured after every layer, and the next pattern of droplets is chosen from the measurement.
</p>
<p>
Start with <a href=\"modelica://InkLoop.Examples.CylinderThresholdFeedback\">Examples.CylinderThresholdFeedback</a>: simulate it and plot
<code>deposition.height[6, 6]</code> (the middle of the part), <code>deposition.height[6, 2]</code> (near its edge) and
<code>deposition.layers_printed</code>.
</p>
</html>"));
end UsersGuide;

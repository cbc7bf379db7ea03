within InkLoop;
package Sensors "What instruments read of a surface"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>Blocks that keep the sensor's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>.</p>
</html>"));
end Sensors;

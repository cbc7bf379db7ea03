within InkLoop;
package Sensors "Sensors: the surface as an instrument measures it"
  extends Icons.SensorsPackage;

  annotation (Documentation(info="<html>
<p>Blocks that keep the sensor's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>.</p>
</html>"));
end Sensors;

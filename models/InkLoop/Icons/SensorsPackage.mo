within InkLoop.Icons;
partial package SensorsPackage "Icon of a package of sensors: a dial with its pointer"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of sensors: a dial with its pointer.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Ellipse(extent={{-70,-90},{70,50}}, lineColor={95,95,95}, fillColor={255,255,255}, fillPattern=FillPattern.Solid, startAngle=0, endAngle=180),
      Line(points={{-49,29},{-40,20}}, color={95,95,95}),
      Line(points={{0,50},{0,36}}, color={95,95,95}),
      Line(points={{49,29},{40,20}}, color={95,95,95}),
      Line(points={{0,-20},{30,26}}, color={238,46,47}, thickness=1)}));
end SensorsPackage;

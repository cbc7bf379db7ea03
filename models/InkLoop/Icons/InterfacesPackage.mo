within InkLoop.Icons;
partial package InterfacesPackage "Icon of a package of connectors and partial blocks: an output connected to an input"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of connectors and partial blocks: an output connected to an input.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-70,30},{-20,0},{-70,-30},{-70,30}}, lineColor={0,0,127}, fillColor={255,255,255}, fillPattern=FillPattern.Solid),
      Line(points={{-20,0},{20,0}}, color={0,0,127}),
      Polygon(points={{20,30},{70,0},{20,-30},{20,30}}, lineColor={0,0,127}, fillColor={0,0,127}, fillPattern=FillPattern.Solid)}));
end InterfacesPackage;

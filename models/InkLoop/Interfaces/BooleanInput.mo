within InkLoop.Interfaces;
connector BooleanInput = input Boolean "True or false, as an input"
  annotation (
    defaultComponentName="u",
    Documentation(info="<html><p>True or false, as an input of a block.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-100,100},{100,0},{-100,-100},{-100,100}}, lineColor={255,0,255}, fillColor={255,0,255}, fillPattern=FillPattern.Solid)}));

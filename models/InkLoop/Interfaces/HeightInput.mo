within InkLoop.Interfaces;
connector HeightInput = input Types.Height "Height, as an input"
  annotation (
    defaultComponentName="u",
    Documentation(info="<html><p>Height, as an input of a block.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-100,100},{100,0},{-100,-100},{-100,100}}, lineColor={0,0,127}, fillColor={0,0,127}, fillPattern=FillPattern.Solid)}));

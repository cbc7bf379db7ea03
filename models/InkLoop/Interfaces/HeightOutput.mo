within InkLoop.Interfaces;
connector HeightOutput = output Types.Height "Height, as an output"
  annotation (
    defaultComponentName="y",
    Documentation(info="<html><p>Height, as an output of a block.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-100,100},{100,0},{-100,-100},{-100,100}}, lineColor={0,0,127}, fillColor={255,255,255}, fillPattern=FillPattern.Solid)}));

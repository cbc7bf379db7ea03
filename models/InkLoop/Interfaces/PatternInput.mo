within InkLoop.Interfaces;
connector PatternInput = input Types.Pattern "Pattern value of a cell, as an input"
  annotation (
    defaultComponentName="u",
    Documentation(info="<html><p>Pattern value of a cell, as an input of a block.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-100,100},{100,0},{-100,-100},{-100,100}}, lineColor={255,127,0}, fillColor={255,127,0}, fillPattern=FillPattern.Solid)}));

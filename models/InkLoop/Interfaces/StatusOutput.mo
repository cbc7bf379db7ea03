within InkLoop.Interfaces;
connector StatusOutput = output Types.Status "State of a component, as an output"
  annotation (
    defaultComponentName="y",
    Documentation(info="<html><p>State of a component, as an output of a block.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-100,100},{100,0},{-100,-100},{-100,100}}, lineColor={255,127,0}, fillColor={255,255,255}, fillPattern=FillPattern.Solid)}));

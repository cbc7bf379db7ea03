within InkLoop.Icons;
partial function Function "Icon of a function"
  annotation (
    Documentation(info="<html><p>Icon of a function.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Text(extent={{-140,105},{140,145}}, textColor={0,0,255}, textString="%name"),
      Ellipse(extent={{-100,-100},{100,100}}, lineColor={108,88,49}, fillColor={255,215,136}, fillPattern=FillPattern.Solid),
      Text(extent={{-90,-90},{90,90}}, textColor={108,88,49}, textString="f")}));
end Function;

within InkLoop.Icons;
partial package Package "Icon of a package"
  annotation (
    Documentation(info="<html><p>Icon of a package.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Rectangle(extent={{-100,-100},{100,100}}, lineColor={95,95,95}, fillColor={248,248,248}, fillPattern=FillPattern.Solid, radius=20)}));
end Package;

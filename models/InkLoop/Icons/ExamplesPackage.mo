within InkLoop.Icons;
partial package ExamplesPackage "Icon of a package of models that run by themselves: a triangle to start"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of models that run by themselves: a triangle to start.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-40,60},{60,0},{-40,-60},{-40,60}}, lineColor={75,138,73}, fillColor={75,138,73}, fillPattern=FillPattern.Solid)}));
end ExamplesPackage;

within InkLoop.Icons;
partial package IconsPackage "Icon of a package of icons: a frame with a circle and a square"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of icons: a frame with a circle and a square.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Ellipse(extent={{-70,-10},{10,70}}, lineColor={95,95,95}, fillColor={215,215,215}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-20,-70},{70,20}}, lineColor={95,95,95}, fillColor={160,160,164}, fillPattern=FillPattern.Solid)}));
end IconsPackage;

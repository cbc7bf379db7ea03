within InkLoop.Icons;
partial package BasesPackage "Icon of a package of classes to extend: a block in broken lines"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of classes to extend: a block in broken lines.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Rectangle(extent={{-60,-60},{60,60}}, lineColor={95,95,95}, pattern=LinePattern.Dash)}));
end BasesPackage;

within InkLoop.Icons;
partial package FunctionsPackage "Icon of a package of functions: the letter f"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of functions: the letter f.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Text(extent={{-90,-90},{90,90}}, textColor={108,88,49}, textString="f")}));
end FunctionsPackage;

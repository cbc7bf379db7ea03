within InkLoop.Icons;
partial package TypesPackage "Icon of a package of types: the letter T"
  extends Package;
  annotation (
    Documentation(info="<html><p>Icon of a package of types: the letter T.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=false, extent={{-100,-100},{100,100}}), graphics={
      Text(extent={{-90,-90},{90,90}}, textColor={95,95,95}, textString="T")}));
end TypesPackage;

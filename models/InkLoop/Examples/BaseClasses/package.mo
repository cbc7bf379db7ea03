within InkLoop.Examples;
package BaseClasses "Common parts of the examples"
  extends Icons.BasesPackage;

  annotation (Documentation(info="<html><p>Common parts of the examples.</p></html>"));
end BaseClasses;

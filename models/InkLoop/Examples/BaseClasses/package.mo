within InkLoop.Examples;
package BaseClasses "What the examples have in common"
  extends Icons.Package;

  annotation (Documentation(info="<html><p>What the examples have in common.</p></html>"));
end BaseClasses;

within InkLoop;
package Interfaces "Connectors and partial blocks of the layer contract"
  extends Icons.InterfacesPackage;

  annotation (Documentation(info="<html>
<p>
A printing loop has three components, and each may be replaced by another that keeps the
<a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>.
</p>
</html>"));
end Interfaces;

within InkLoop;
package Deposition "Deposition models: the surface after a layer of droplets"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>Blocks that keep the deposition's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>.</p>
</html>"));
end Deposition;

within InkLoop;
package Deposition "What layers of droplets make of a surface"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>Blocks that keep the deposition's side of the <a href=\"modelica://InkLoop.UsersGuide.LayerContract\">layer contract</a>.</p>
</html>"));
end Deposition;

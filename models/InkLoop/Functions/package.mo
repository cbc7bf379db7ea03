within InkLoop;
package Functions "The maps behind the blocks, as functions of arrays"
  extends Icons.FunctionsPackage;

  annotation (Documentation(info="<html>
<p>
Every model of the library is a map from one array to the next; the blocks only define when it is applied. A surface is
<code>height[nx, ny]</code>, its first index runs along x.
</p>
</html>"));
end Functions;

within InkLoop;
package Control "Controllers: the droplets of the next layer"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>
Controllers that fit into a Modelica model. The layer controller of inkloop, which plans several layers ahead, is not included:
it is an optimisation, not an equation.
</p>
</html>"));
end Control;

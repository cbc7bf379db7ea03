within InkLoop;
package Control "Which droplets come next"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>
Controllers that fit into a Modelica model. The layer controller of inkloop, which looks several layers ahead, is not stated here:
it is an optimisation, not an equation.
</p>
</html>"));
end Control;

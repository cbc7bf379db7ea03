within InkLoop;
package Examples "Prints in open and closed loop"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>Models that run by themselves. Each says what to plot.</p>
</html>"));
end Examples;

within InkLoop;
package Examples "Prints in open and closed loop"
  extends Icons.ExamplesPackage;

  annotation (Documentation(info="<html>
<p>Complete models. The documentation of each names the variables to plot.</p>
</html>"));
end Examples;

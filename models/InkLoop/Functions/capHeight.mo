within InkLoop.Functions;
pure function capHeight "Height of a spherical cap of known volume and base"
  extends Icons.Function;

  input Types.Volume volume "Volume of the cap";
  input Types.Length baseRadius "Radius of its base";
  output Types.Height height "Height of its middle";

protected
  constant Types.Number PI = 3.14159265358979323846 "Ratio of a circle's circumference to its diameter";
  Types.Number p = 3*volume/(PI*baseRadius^3) "Right-hand side of the equation for sinh";

algorithm
  height := 2*baseRadius*sinh(log(p + sqrt(p^2 + 1))/3);

  annotation (Documentation(info="<html>
<p>
The root of <code>volume = pi/6 height (3 baseRadius^2 + height^2)</code>. With height = 2 baseRadius sinh t the equation becomes
sinh(3 t) = 3 volume/(pi baseRadius^3).
</p>
</html>"));
end capHeight;

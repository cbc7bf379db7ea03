within InkLoop.Functions;
pure function capHeight "Height of a spherical cap of known volume and base"
  extends Icons.Function;

  input Types.Volume volume "Volume of the cap";
  input Types.Length base_radius "Radius of its base";
  output Types.Height height "Height of its middle";

protected
  constant Types.Number PI = 3.14159265358979323846 "Ratio of a circle's circumference to its diameter";
  Types.Number p = 3*volume/(PI*base_radius^3) "Right-hand side of the equation for sinh";

algorithm
  height := 2*base_radius*sinh(log(p + sqrt(p^2 + 1))/3);

  annotation (Documentation(info="<html>
<p>
The root of <code>volume = pi/6 height (3 base_radius^2 + height^2)</code>. With height = 2 base_radius sinh t the equation becomes
sinh(3 t) = 3 volume/(pi base_radius^3).
</p>
</html>"));
end capHeight;

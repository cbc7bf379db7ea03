within InkLoop.Validation;
model CapShares "A spherical cap over cells against its closed forms"
  extends Icons.Example;

  constant Types.Number PI = 3.14159265358979323846 "Ratio of a circle's circumference to its diameter";
  parameter Types.Length radius = 54e-6 "Radius of the base";
  parameter Types.Volume drop = 5.730831e-14 "Volume of the cap";
  parameter Types.Height top = Functions.capHeight(drop, radius) "Height of the cap";
  Types.Volume quarter "Volume over a quarter of the base";
  Types.Area disc "Area of a quarter of the base";
  Types.Volume slice "Volume over the half plane x >= radius/2, upper half";
  Types.Area segment "Area of the same";

equation
  (quarter, disc) = Functions.capOverRectangle(radius, top, {0, radius}, {0, radius});
  (slice, segment) = Functions.capOverRectangle(radius, top, {radius/2, 2*radius}, {0, 2*radius});

  when time >= 0.5 then
    assert(abs(PI/6*top*(3*radius^2 + top^2) - drop) < 1e-13*drop, "the cap does not have the volume of the drop");
    assert(abs(4*quarter - drop) < 1e-12*drop, "four quarters are not the cap");
    assert(abs(4*disc - PI*radius^2) < 1e-12*PI*radius^2, "four quarters are not the base");
    assert(abs(2*segment - radius^2*(PI/3 - sqrt(3)/4)) < 1e-12*radius^2, "the segment is not that of a circle");
    assert(slice > 0 and 2*slice < drop/2, "the slice is not less than half the cap");
  end when;

  annotation (
    experiment(StopTime=1, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>The volume of a cap is pi/6 a (3 r<sup>2</sup> + a<sup>2</sup>); a circular segment beyond r/2 has the area r<sup>2</sup> (pi/3 - sqrt(3)/4).</p>
</html>"));
end CapShares;

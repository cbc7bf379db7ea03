within InkLoop.Functions;
pure function capOverRectangle "Volume of a spherical cap over a rectangle, and the area that it covers there"
  extends Icons.Function;

  input Types.Length baseRadius "Radius of the base, around the origin";
  input Types.Height apex "Height in the middle, up to baseRadius";
  input Types.Length x[2] "Sides of the rectangle along x, both at least 0, ascending";
  input Types.Length y[2] "Sides of the rectangle along y, both at least 0, ascending";
  output Types.Volume volume "Volume over the rectangle";
  output Types.Area area "Area of the rectangle that the cap covers";

protected
  constant Integer PANELS = 8 "Panels of a piece";
  constant Types.Number NODE[8] = {-0.9602898564975363, -0.7966664774136267, -0.5255324099163290, -0.1834346424956498,
    0.1834346424956498, 0.5255324099163290, 0.7966664774136267, 0.9602898564975363} "Nodes of the Gauss rule on -1 to 1";
  constant Types.Number WEIGHT[8] = {0.1012285362903763, 0.2223810344533745, 0.3137066458778873, 0.3626837833783620,
    0.3626837833783620, 0.3137066458778873, 0.2223810344533745, 0.1012285362903763} "Its weights";
  Types.Length centre = (baseRadius^2 - apex^2)/(2*apex) "Depth of the sphere's centre below the base";
  Types.Length radius = centre + apex "Radius of the sphere";
  Types.Angle bound[4] = zeros(4) "Angles between which the integrand is smooth, ascending";
  Types.Number s = 0 "Place in a piece, -1 to 1";
  Types.Angle angle = 0 "Angle of a node";
  Types.Length step = 0 "Weight of a node, along x";
  Types.Length chord = 0 "Half the width of the base at the node";
  Types.Length cut = 0 "Radius of the circle that the sphere has at the node";
  Types.Length low = 0 "Lower end of the strip along y";
  Types.Length high = 0 "Upper end of the strip along y";

algorithm
  volume := 0;
  area := 0;
  bound[1] := asin(min(1, x[1]/baseRadius));
  bound[4] := asin(min(1, x[2]/baseRadius));
  bound[2] := min(bound[4], max(bound[1], acos(min(1, y[2]/baseRadius))));
  bound[3] := min(bound[4], max(bound[1], acos(min(1, y[1]/baseRadius))));
  for piece in 1:3 loop
    for k in 0:8*PANELS - 1 loop
      s := (2*div(k, 8) + 1 + NODE[mod(k, 8) + 1])/PANELS - 1;
      angle := bound[piece] + (bound[piece + 1] - bound[piece])*(0.5 + 0.25*s*(3 - s^2));
      step := 0.75*(bound[piece + 1] - bound[piece])*(1 - s^2)*WEIGHT[mod(k, 8) + 1]/PANELS*baseRadius*cos(angle);
      chord := baseRadius*cos(angle);
      cut := sqrt(max(0, radius^2 - (baseRadius*sin(angle))^2));
      low := min(chord, y[1]);
      high := min(chord, y[2]);
      area := area + step*(high - low);
      volume := volume + step*(0.5*(high*sqrt(max(0, cut^2 - high^2)) - low*sqrt(max(0, cut^2 - low^2))
        + cut^2*(asin(high/cut) - asin(low/cut))) - centre*(high - low));
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>
With the sphere's centre a depth c below the base and its radius R, the surface of the cap is sqrt(R<sup>2</sup> - x<sup>2</sup> - y<sup>2</sup>) - c.
The integral over y is closed; the one over x = r sin(angle) is taken by Gauss rules of 8 nodes, in pieces that end where the rim
crosses a side of the rectangle, and with a substitution that is slow at both ends of a piece.
</p>
</html>"));
end capOverRectangle;

within InkLoop.Functions;
pure function lineMean "Gaussian-weighted mean around one place of a line"
  extends Icons.Function;

  input Types.Height line[:] "Heights along a line";
  input Integer at "Place in the line";
  input Types.Length pitch "Distance of neighbouring places";
  input Types.Length radius "Standard deviation of the weights, above 0";
  output Types.Height mean "Weighted mean";

protected
  constant Types.Number REACH = 4 "Standard deviations; 6e-5 of the weight lies beyond";
  Integer reach = integer(min(size(line, 1), floor(REACH*radius/pitch))) "Places on either side that count";
  Types.Number weight = 0 "Weight of a place";
  Types.Number weights = 0 "Sum of the weights";
  Types.Height total = 0 "Weighted sum";

algorithm
  for k in 1:size(line, 1) loop
    weight := if abs(k - at) <= reach then exp(-0.5*((k - at)*pitch/radius)^2) else 0;
    total := total + weight*line[k];
    weights := weights + weight;
  end for;
  mean := total/weights;

  annotation (Documentation(info="<html>
<p>Weights exp(-d<sup>2</sup>/(2 radius<sup>2</sup>)) up to four standard deviations, normalised again where they extend beyond the end.</p>
</html>"));
end lineMean;

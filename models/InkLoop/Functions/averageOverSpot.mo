within InkLoop.Functions;
pure function averageOverSpot "Mean over the spot of the sensor"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface";
  input Types.Length pitch "Distance of neighbouring cells";
  input Types.Length radius "Standard deviation of the spot; 0: a point";
  output Types.Height average[size(height, 1), size(height, 2)] "Mean over the spot";

protected
  Types.Height lines[size(height, 1), size(height, 2)] = height "Averaged along y";

algorithm
  average := height;
  if radius > 0 then
    for i in 1:size(height, 1) loop
      for j in 1:size(height, 2) loop
        lines[i, j] := lineMean(height[i, :], j, pitch, radius);
      end for;
    end for;
    for i in 1:size(height, 1) loop
      for j in 1:size(height, 2) loop
        average[i, j] := lineMean(lines[:, j], i, pitch, radius);
      end for;
    end for;
  end if;

  annotation (Documentation(info="<html>
<p>A Gaussian spot, which is the product of one <a href=\"modelica://InkLoop.Functions.lineMean\">weighted mean</a> along y and one along x.</p>
</html>"));
end averageOverSpot;

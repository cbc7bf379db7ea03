within InkLoop.Functions;
pure function displace "Surface at a distance from each cell"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface";
  input Types.Number shift[2] "Distance along x and y in cells";
  output Types.Height displaced[size(height, 1), size(height, 2)] "Surface there";

protected
  Types.Number place[2] = {1, 1} "Place that a cell reads, from 1";
  Integer low[2] = {1, 1} "Cell before that place";
  Integer high[2] = {1, 1} "Cell after it";
  Types.Share share[2] = {0, 0} "Distance from the cell before it";

algorithm
  for i in 1:size(height, 1) loop
    for j in 1:size(height, 2) loop
      place := {max(1, min(size(height, 1), i + shift[1])), max(1, min(size(height, 2), j + shift[2]))};
      low := {integer(place[1]), integer(place[2])};
      high := {min(size(height, 1), low[1] + 1), min(size(height, 2), low[2] + 1)};
      share := place - low;
      displaced[i, j] := (1 - share[1])*((1 - share[2])*height[low[1], low[2]] + share[2]*height[low[1], high[2]])
        + share[1]*((1 - share[2])*height[high[1], low[2]] + share[2]*height[high[1], high[2]]);
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>Linear between cells; beyond the border the surface is as high as there.</p>
</html>"));
end displace;

within InkLoop.Functions;
pure function slopeAt "Slope of a surface at one cell"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface";
  input Integer i "Cell along x";
  input Integer j "Cell along y";
  input Types.Length pitch "Distance of neighbouring cells";
  output Types.Slope slope "Amount of the gradient";

protected
  Integer low[2] = {max(1, i - 1), max(1, j - 1)} "Neighbours on the low sides";
  Integer high[2] = {min(size(height, 1), i + 1), min(size(height, 2), j + 1)} "Neighbours on the high sides";
  Types.Slope alongX = (height[high[1], j] - height[low[1], j])/(max(1, high[1] - low[1])*pitch) "Slope along x";
  Types.Slope alongY = (height[i, high[2]] - height[i, low[2]])/(max(1, high[2] - low[2])*pitch) "Slope along y";

algorithm
  slope := sqrt(alongX^2 + alongY^2);

  annotation (Documentation(info="<html>
<p>Central differences, one-sided at the border, 0 along a single cell.</p>
</html>"));
end slopeAt;

within InkLoop.Functions;
pure function capShares "Shares of a drop on flat ground: volume and covered area of the cells around it"
  extends Icons.Function;

  input Types.Height height_scale "Volume of a drop over the area of a cell";
  input Types.Length cap_radius "Base radius of a drop on flat ground";
  input Types.Length pitch "Distance of neighbouring cells";
  output Types.Share share[2, 3] "Volume shares, then covered shares, of the cell that is hit, of a side and of a corner neighbour";

protected
  Types.Height apex = capHeight(height_scale*pitch^2, cap_radius) "Height of the drop";
  Types.Length near[2] = {0, pitch/2} "Half of the cell that is hit";
  Types.Length far[2] = {pitch/2, 3*pitch/2} "The next cell";
  Types.Volume middle = 0 "Volume over a quarter of the cell that is hit";
  Types.Volume side = 0 "Volume over half a side neighbour";
  Types.Volume corner = 0 "Volume over a corner neighbour";
  Types.Volume whole = 0 "Volume over all nine cells";
  Types.Area middleArea = 0 "Area covered in a quarter of the cell that is hit";
  Types.Area sideArea = 0 "Area covered in half a side neighbour";
  Types.Area cornerArea = 0 "Area covered in a corner neighbour";

algorithm
  (middle, middleArea) := capOverRectangle(cap_radius, apex, near, near);
  (side, sideArea) := capOverRectangle(cap_radius, apex, far, near);
  (corner, cornerArea) := capOverRectangle(cap_radius, apex, far, far);
  whole := 4*middle + 8*side + 4*corner;
  share := {{4*middle/whole, 2*side/whole, corner/whole},
    {min(1, 4*middleArea/pitch^2), min(1, 2*sideArea/pitch^2), min(1, cornerArea/pitch^2)}};

  annotation (Documentation(info="<html>
<p>
The drop is a spherical cap; its volume shares are scaled to sum to 1 over the 3 x 3 cells around it.
</p>
</html>"));
end capShares;

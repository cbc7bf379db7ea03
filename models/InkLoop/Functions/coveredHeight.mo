within InkLoop.Functions;
pure function coveredHeight "Height of the covered part of each cell"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface, mean over each cell";
  input Types.Share area[size(height, 1), size(height, 2)] "Covered share of each cell";
  input Types.Height substrate[size(height, 1), size(height, 2)] "Height of the bare ground";
  output Types.Height covered[size(height, 1), size(height, 2)] "Height of the covered part, or of the bare ground";

algorithm
  for i in 1:size(height, 1) loop
    for j in 1:size(height, 2) loop
      covered[i, j] := substrate[i, j] + (if area[i, j] > 0 then (height[i, j] - substrate[i, j])/area[i, j] else 0);
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>
Equation (2) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>, h = c v/a: the ink covers only part of the cell, at this height.
</p>
</html>"));
end coveredHeight;

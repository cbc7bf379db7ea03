within InkLoop.Functions;
pure function heightDifference "Height of the cells around a drop minus the mean of the cells that touch them"
  extends Icons.Function;

  input Types.Height height[:, :] "Heights of the covered parts";
  input Integer i "Cell that is hit, along x";
  input Integer j "Cell that is hit, along y";
  output Types.Height difference[3, 3] "One for each cell of the region of interest; 0 outside the grid";
  output Types.Height largest "Largest amount of them";

protected
  Types.Height around = 0 "Sum over the cells that touch";
  Integer touching = 0 "Their number";

algorithm
  difference := zeros(3, 3);
  largest := 0;
  for qi in -1:1 loop
    for qj in -1:1 loop
      if isInside(i + qi, j + qj, size(height, 1), size(height, 2)) then
        around := -height[i + qi, j + qj];
        touching := -1;
        for ki in -1:1 loop
          for kj in -1:1 loop
            if abs(ki - qi) <= 1 and abs(kj - qj) <= 1 and isInside(i + ki, j + kj, size(height, 1), size(height, 2)) then
              around := around + height[i + ki, j + kj];
              touching := touching + 1;
            end if;
          end for;
        end for;
        difference[qi + 2, qj + 2] := if touching > 0 then height[i + qi, j + qj] - around/max(1, touching) else 0;
        largest := max(largest, abs(difference[qi + 2, qj + 2]));
      end if;
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>
Equations (7) to (9) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>: the region of interest is the 3 x 3 cells around the
drop, cut to the grid; the mean is over the cells that touch <em>inside</em> the region, 8, 5 or 3 of them. This interpretation gives the
published differences (19).
</p>
</html>"));
end heightDifference;

within InkLoop.Functions;
pure function cylinder "A material on all cells of a disc in the middle of the grid"
  extends Icons.Function;

  input Integer nx "Cells along x";
  input Integer ny "Cells along y";
  input Types.Number radius "Radius in cells";
  output Types.Pattern material[nx, ny] "1 inside, 0 outside";

algorithm
  for i in 1:nx loop
    for j in 1:ny loop
      material[i, j] := if (i - 0.5*(nx + 1))^2 + (j - 0.5*(ny + 1))^2 <= radius^2 then 1 else 0;
    end for;
  end for;

  annotation (Documentation(info="<html><p>The cells of a cylinder: a cell belongs to it if its centre does.</p></html>"));
end cylinder;

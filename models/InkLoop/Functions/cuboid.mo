within InkLoop.Functions;
pure function cuboid "A material on all cells but a margin"
  extends Icons.Function;

  input Integer nx "Cells along x";
  input Integer ny "Cells along y";
  input Integer margin = 0 "Empty cells on each side";
  output Types.Pattern material[nx, ny] "1 inside, 0 in the margin";

algorithm
  for i in 1:nx loop
    for j in 1:ny loop
      material[i, j] := if min(min(i, nx + 1 - i), min(j, ny + 1 - j)) > margin then 1 else 0;
    end for;
  end for;

  annotation (Documentation(info="<html><p>The cells of a cuboid.</p></html>"));
end cuboid;

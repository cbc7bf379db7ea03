within InkLoop.Functions;
pure function isInside "Tests whether a cell is on the grid"
  extends Icons.Function;

  input Integer i "Cell along x";
  input Integer j "Cell along y";
  input Integer nx "Cells along x";
  input Integer ny "Cells along y";
  output Boolean inside "= true, if the cell lies on the grid";

algorithm
  inside := i >= 1 and i <= nx and j >= 1 and j <= ny;

  annotation (Documentation(info="<html><p>1 &le; i &le; nx and 1 &le; j &le; ny.</p></html>"));
end isInside;

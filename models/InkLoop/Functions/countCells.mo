within InkLoop.Functions;
pure function countCells "Number of cells of a pattern with a value"
  extends Icons.Function;

  input Types.Pattern pattern[:, :] "Pattern of a layer";
  input Types.Pattern value "Value to count";
  output Integer count "Cells with the value";

algorithm
  count := 0;
  for i in 1:size(pattern, 1) loop
    for j in 1:size(pattern, 2) loop
      if pattern[i, j] == value then
        count := count + 1;
      end if;
    end for;
  end for;

  annotation (Documentation(info="<html><p>The number of cells whose value is <code>value</code>.</p></html>"));
end countCells;

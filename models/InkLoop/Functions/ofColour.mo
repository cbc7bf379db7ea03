within InkLoop.Functions;
pure function ofColour "The droplets of a pattern that belong to one colour"
  extends Icons.Function;

  input Types.Pattern pattern[:, :] "Pattern of the layer";
  input Integer colour "2 (i modulo 2) + (j modulo 2), with i and j counted from 0";
  output Types.Pattern part[size(pattern, 1), size(pattern, 2)] "The same, and 0 on the cells of other colours";

algorithm
  for i in 1:size(pattern, 1) loop
    for j in 1:size(pattern, 2) loop
      part[i, j] := if 2*mod(i - 1, 2) + mod(j - 1, 2) == colour then pattern[i, j] else 0;
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>Cell (i, j), counted from 0, has the colour 2 (i modulo 2) + (j modulo 2). Cells of one colour never touch.</p>
</html>"));
end ofColour;

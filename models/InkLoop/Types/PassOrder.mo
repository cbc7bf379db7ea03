within InkLoop.Types;
type PassOrder = enumeration(
    raster "(0, 0), (0, 1), (1, 0), (1, 1)",
    diagonal "(0, 0), (1, 1), (0, 1), (1, 0)") "Order of the four passes, as remainders by 2 of the cell's numbers counted from 0"
  annotation (Documentation(info="<html>
<p>A layer in four passes prints a 2 x 2 colouring: cell (i, j), counted from 0, belongs to (i modulo 2, j modulo 2).</p>
</html>"));

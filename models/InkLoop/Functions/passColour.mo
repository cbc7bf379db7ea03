within InkLoop.Functions;
pure function passColour "Colour of the 2 x 2 colouring that a pass prints"
  extends Icons.Function;

  input Integer pass "Pass of the layer, 0 to 3";
  input Integer layer "Number of the layer, from 1";
  input Types.PassOrder pass_order "Order of the four passes";
  input Integer pass_rotation "Places by which the order moves from layer to layer";
  output Integer colour "2 (i modulo 2) + (j modulo 2), with i and j counted from 0";

protected
  constant Integer DIAGONAL[4] = {0, 3, 1, 2} "Colours in diagonal order";
  Integer place = mod(pass_rotation*layer + pass, 4) "Place in the order";

algorithm
  colour := if pass_order == Types.PassOrder.raster then place else DIAGONAL[place + 1];

  annotation (Documentation(info="<html>
<p>
Layer n starts <code>pass_rotation</code> n places later in the order; the first layer is n = 1. A rotation distributes the effect of the
pass order over the colours.
</p>
</html>"));
end passColour;

within InkLoop.Functions.Random;
pure function wideProduct "Product of two words of 32 bits, as two words"
  extends Icons.Function;

  input Real a "Word, a whole number from 0 to 2^32 - 1";
  input Real b "Word";
  output Real high "Upper word of the product";
  output Real low "Lower word of the product";

protected
  constant Real HALF = 65536 "2^16";
  Real a_low = mod(a, HALF) "Lower half of a";
  Real a_high = floor(a/HALF) "Upper half of a";
  Real b_low = mod(b, HALF) "Lower half of b";
  Real b_high = floor(b/HALF) "Upper half of b";
  Real lowest = a_low*b_low "Product of the lower halves";
  Real first = a_high*b_low + floor(lowest/HALF) "First cross product with what is carried";
  Real second = a_low*b_high + mod(first, HALF) "Second cross product with the lower half of the first";

algorithm
  high := a_high*b_high + floor(first/HALF) + floor(second/HALF);
  low := mod(second, HALF)*HALF + mod(lowest, HALF);

  annotation (Documentation(info="<html><p>Products of halves of 16 bits: every intermediate result is below 2<sup>53</sup>, so it is exact.</p></html>"));
end wideProduct;

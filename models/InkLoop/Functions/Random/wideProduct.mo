within InkLoop.Functions.Random;
pure function wideProduct "Product of two words of 32 bits, as two words"
  extends Icons.Function;

  input Word a "Word";
  input Word b "Word";
  output Word high "Upper word of the product";
  output Word low "Lower word of the product";

protected
  constant Types.Number HALF = 65536 "2^16";
  Word aLow = mod(a, HALF) "Lower half of a";
  Word aHigh = floor(a/HALF) "Upper half of a";
  Word bLow = mod(b, HALF) "Lower half of b";
  Word bHigh = floor(b/HALF) "Upper half of b";
  Types.Number lowest = aLow*bLow "Product of the lower halves";
  Types.Number first = aHigh*bLow + floor(lowest/HALF) "First cross product with what is carried";
  Types.Number second = aLow*bHigh + mod(first, HALF) "Second cross product with the lower half of the first";

algorithm
  high := aHigh*bHigh + floor(first/HALF) + floor(second/HALF);
  low := mod(second, HALF)*HALF + mod(lowest, HALF);

  annotation (Documentation(info="<html><p>Products of halves of 16 bits: every intermediate result is below 2<sup>53</sup>, so it is exact.</p></html>"));
end wideProduct;

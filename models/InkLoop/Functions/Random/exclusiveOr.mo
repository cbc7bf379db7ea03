within InkLoop.Functions.Random;
pure function exclusiveOr "Bitwise exclusive or of three words of 32 bits"
  extends Icons.Function;

  input Real a "Word, a whole number from 0 to 2^32 - 1";
  input Real b "Word";
  input Real c "Word";
  output Real word "Word whose bits say where an odd number of the three has a 1";

protected
  Real x = a "What is left of a";
  Real y = b "What is left of b";
  Real z = c "What is left of c";
  Real place = 1 "Value of the bit";

algorithm
  word := 0;
  for k in 1:32 loop
    word := word + place*mod(x + y + z, 2);
    x := floor(x/2);
    y := floor(y/2);
    z := floor(z/2);
    place := 2*place;
  end for;

  annotation (Documentation(info="<html><p>From the lowest bit on: the sum of three whole numbers is odd when an odd number of them is.</p></html>"));
end exclusiveOr;

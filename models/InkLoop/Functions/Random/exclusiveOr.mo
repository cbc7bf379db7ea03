within InkLoop.Functions.Random;
pure function exclusiveOr "Bitwise exclusive or of three words of 32 bits"
  extends Icons.Function;

  input Word a "Word";
  input Word b "Word";
  input Word c "Word";
  output Word word "Word with a 1 in each bit where an odd number of the three has a 1";

protected
  Word x = a "Remaining bits of a";
  Word y = b "Remaining bits of b";
  Word z = c "Remaining bits of c";
  Types.Number place = 1 "Value of the bit";

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

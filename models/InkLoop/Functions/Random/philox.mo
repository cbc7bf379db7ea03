within InkLoop.Functions.Random;
pure function philox "Philox 4x32-10: four random words for a key and a counter"
  extends Icons.Function;

  input Word key[2] "Two words";
  input Word counter[4] "Four words";
  output Word word[4] "Four random words";

protected
  constant Types.Number WORD = 4294967296.0 "2^32";
  Word k0 = key[1] "First word of the key of the round";
  Word k1 = key[2] "Second word of the key of the round";
  Word x0 = counter[1] "First word";
  Word x1 = counter[2] "Second word";
  Word x2 = counter[3] "Third word";
  Word x3 = counter[4] "Fourth word";
  Word leftHigh = 0 "Upper word of the first product";
  Word leftLow = 0 "Lower word of the first product";
  Word rightHigh = 0 "Upper word of the second product";
  Word rightLow = 0 "Lower word of the second product";

algorithm
  for round in 1:10 loop
    (leftHigh, leftLow) := wideProduct(3528531795.0, x0);
    (rightHigh, rightLow) := wideProduct(3449720151.0, x2);
    x0 := exclusiveOr(rightHigh, x1, k0);
    x1 := rightLow;
    x2 := exclusiveOr(leftHigh, x3, k1);
    x3 := leftLow;
    k0 := mod(k0 + 2654435769.0, WORD);
    k1 := mod(k1 + 3144134277.0, WORD);
  end for;
  word := {x0, x1, x2, x3};

  annotation (Documentation(info="<html>
<p>
Ten rounds with the multipliers 0xD2511F53 and 0xCD9E8D57 and the key increments 0x9E3779B9 and 0xBB67AE85 of
<a href=\"modelica://InkLoop.UsersGuide.References\">[Salmon2011]</a>.
</p>
</html>"));
end philox;

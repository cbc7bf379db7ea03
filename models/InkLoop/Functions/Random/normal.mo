within InkLoop.Functions.Random;
pure function normal "Random number of the standard normal distribution"
  extends Icons.Function;

  input Integer seed "Seed, at least 0";
  input Integer purpose "One of Stream";
  input Integer cell "Number of the cell, from 0";
  input Integer number "Number of the layer or the scan, from 0";
  output Types.Number z "Mean 0, standard deviation 1";

protected
  constant Types.Angle twoPi = 6.283185307179586476925286766559 "Angle of a full turn";
  Word word[4] = philox({seed, purpose}, {cell, 0, number, 0}) "Random words";
  Types.Share u1 = (word[1]*2097152.0 + floor(word[2]/2048.0))/9007199254740992.0 "First uniform number";
  Types.Share u2 = (word[3]*2097152.0 + floor(word[4]/2048.0))/9007199254740992.0 "Second uniform number";

algorithm
  z := sqrt(-2*log(1 - u1))*cos(twoPi*u2);

  annotation (Documentation(info="<html><p>Box and Muller: sqrt(-2 ln(1 - u1)) cos(2 pi u2).</p></html>"));
end normal;

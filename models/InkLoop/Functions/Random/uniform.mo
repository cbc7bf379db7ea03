within InkLoop.Functions.Random;
pure function uniform "Uniform random number"
  extends Icons.Function;

  input Integer seed "Seed, at least 0";
  input Integer purpose "One of Stream";
  input Integer cell "Number of the cell, from 0";
  input Integer number "Number of the layer or the scan, from 0";
  output Types.Share u "Below 1, with 53 bits";

protected
  Word word[4] = philox({seed, purpose}, {cell, 0, number, 0}) "Random words";

algorithm
  u := (word[1]*2097152.0 + floor(word[2]/2048.0))/9007199254740992.0;

  annotation (Documentation(info="<html><p>The upper 53 of the first 64 random bits, divided by 2<sup>53</sup>.</p></html>"));
end uniform;

within InkLoop.Functions.Random;
type Word = Real (final unit="1", min=0) "Word of 32 bits, a whole number from 0 to 2^32 - 1"
  annotation (Documentation(info="<html><p>A Modelica Integer is only guaranteed to hold 31 bits; a Real holds every whole number up to 2<sup>53</sup>.</p></html>"));

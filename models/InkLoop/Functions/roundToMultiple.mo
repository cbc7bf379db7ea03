within InkLoop.Functions;
pure function roundToMultiple "Nearest multiple of a step, halves to the even one"
  extends Icons.Function;

  input Types.Height value "Value to round";
  input Types.Height step "Step; 0: no rounding";
  output Types.Height rounded "Multiple of the step";

protected
  Types.Number steps = if step > 0 then value/step else 0 "Value in steps";
  Types.Number whole = floor(steps) "Whole steps below";
  Types.Number odd = mod(whole, 2) "1, if their number is odd";

algorithm
  rounded := if step <= 0 then value else
    step*(if steps - whole > 0.5 or (steps - whole >= 0.5 and odd > 0.5) then whole + 1 else whole);

  annotation (Documentation(info="<html><p>As the rounding of IEEE 754: halves go to the even multiple.</p></html>"));
end roundToMultiple;

within InkLoop.Types;
type Number = Real (final unit="1") "Number without a unit"
  annotation (Documentation(info="<html><p>Ratios, weights, nodes of a rule, multiples of a step.</p></html>"));

within InkLoop.Types;
type InverseLength = Real (final unit="1/m") "Change per length"
  annotation (Documentation(info="<html><p>Coefficients that turn a height difference into a share.</p></html>"));

within InkLoop.Types;
type Share = Real (final unit="1", min=0, max=1) "Part of a whole, 0 to 1"
  annotation (Documentation(info="<html><p>Covered shares of cells, shares of a drop, probabilities, amplitudes of variations.</p></html>"));

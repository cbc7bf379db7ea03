within InkLoop.Types;
type Slope = Real (final unit="1") "Slope of a surface, rise over run"
  annotation (Documentation(info="<html><p>The tangent of the angle to the plane of the substrate.</p></html>"));

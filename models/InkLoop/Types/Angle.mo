within InkLoop.Types;
type Angle = Real (final quantity="Angle", final unit="rad") "Angle"
  annotation (Documentation(info="<html><p>Angles of a rim and of a full turn.</p></html>"));

within InkLoop.Types;
type Area = Real (final quantity="Area", final unit="m2", min=0) "Area in the plane"
  annotation (Documentation(info="<html><p>Areas of cells and of the ink on them.</p></html>"));

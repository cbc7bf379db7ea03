within InkLoop.Types;
type Length = Real (final quantity="Length", final unit="m", displayUnit="um", min=0) "Length in the plane"
  annotation (Documentation(info="<html><p>Distances in the plane of the substrate, as pitch and spot radius.</p></html>"));

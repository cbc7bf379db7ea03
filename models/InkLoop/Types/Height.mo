within InkLoop.Types;
type Height = Real (final quantity="Length", final unit="m", displayUnit="um") "Height of a surface, or a part of it"
  annotation (Documentation(info="<html><p>A height may be below 0, the plane of the substrate.</p></html>"));

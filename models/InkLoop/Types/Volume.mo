within InkLoop.Types;
type Volume = Real (final quantity="Volume", final unit="m3") "Volume"
  annotation (Documentation(info="<html><p>Heights summed over cells, times the area of a cell.</p></html>"));

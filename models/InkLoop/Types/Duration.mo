within InkLoop.Types;
type Duration = Real (final quantity="Time", final unit="s", min=0) "Duration"
  annotation (Documentation(info="<html><p>Time that a layer or a scan takes.</p></html>"));

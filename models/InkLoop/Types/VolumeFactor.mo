within InkLoop.Types;
type VolumeFactor = Real (final unit="1", min=0) "Volume of a droplet over its nominal volume"
  annotation (Documentation(info="<html><p>1 is a droplet of nominal volume, 0 a nozzle that is blocked.</p></html>"));

within InkLoop.Types;
type Layer = Integer (min=-1) "Number of a layer: 0 is the start surface, -1 none"
  annotation (Documentation(info="<html><p>Sequence numbers of the layer contract: 0 is the start surface, -1 means none yet.</p></html>"));

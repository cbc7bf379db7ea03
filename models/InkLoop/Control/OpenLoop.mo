within InkLoop.Control;
block OpenLoop "The same full layer each time, whatever has been measured"
  extends Interfaces.PartialController;

  parameter Types.Pattern material[nx, ny] = fill(1, nx, ny) "Material of each cell in a full layer";

equation
  next = material;

  annotation (
    defaultComponentName="controller",
    Documentation(info="<html>
<p>
The traditional way to print: <code>layers_max</code> full layers. It waits for the scans and ignores them, so open and closed loop differ only in
the pattern.
</p>
</html>"));
end OpenLoop;

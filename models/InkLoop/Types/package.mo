within InkLoop;
package Types "Quantities, choices and records"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>
Quantities with SI units; heights are shown in micrometres. Own types instead of those of the Modelica Standard Library keep
the library free of any other.
</p>
</html>"));
end Types;

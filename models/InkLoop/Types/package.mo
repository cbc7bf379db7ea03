within InkLoop;
package Types "Quantities, choices and records"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>
Quantities with SI units; heights are shown in micrometres. They are defined here and not taken from the Modelica Standard Library, so that
the library depends on no other.
</p>
</html>"));
end Types;

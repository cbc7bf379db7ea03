within InkLoop;
package Types "Quantities, choices and records"
  extends Icons.TypesPackage;

  annotation (Documentation(info="<html>
<p>
Quantities with SI units, as in <code>Modelica.Units.SI</code>; heights are shown in micrometres. They are defined here and not taken from there, so that
the library depends on no other.
</p>
</html>"));
end Types;

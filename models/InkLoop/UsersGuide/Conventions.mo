within InkLoop.UsersGuide;
class Conventions "Conventions"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<ul>
<li>SI units inside; heights are shown in micrometres (<code>displayUnit</code>).</li>
<li>A map is <code>height[nx, ny]</code>: the first index runs along x. The FMUs of inkloop count cells from 0, Modelica from 1; in formulas where
it matters the documentation states it.</li>
<li>What an FMU of inkloop has too bears the name that it has there, with underscores (<code>layer_duration</code>), so that scripts and results fit both. An ink
is a record here and three parameters there (<code>ink_a.h1</code> and <code>h1_a</code>). All other names are written in camelCase, as in the Modelica Standard Library.</li>
<li><code>status</code> is an enumeration; its first value is number 1 here and 0 in the FMUs.</li>
<li>The types have the <code>quantity</code> and <code>unit</code> of <code>Modelica.Units.SI</code>, and connect to it, but are defined in this library: it then needs no other
one, of no certain version, and heights can be shown in micrometres.</li>
<li>Boolean variables read \"= true, if ...\".</li>
<li>Random numbers depend on seed, stream, cell and layer only, and are the same bits as in the FMUs.</li>
<li>Variables change only at events, so any integrator will do.</li>
</ul>
</html>"));
end Conventions;

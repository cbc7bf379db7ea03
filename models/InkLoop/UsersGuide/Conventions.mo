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
<li>Names are those of the FMUs, variable by variable. An ink is a record here and three parameters there (<code>ink_a.h1</code> and
<code>h1_a</code>).</li>
<li>Boolean variables read \"= true, if ...\".</li>
<li>Random numbers depend on seed, stream, cell and layer only, and are the same bits as in the FMUs.</li>
<li>Variables change only at events, so any integrator will do.</li>
</ul>
</html>"));
end Conventions;

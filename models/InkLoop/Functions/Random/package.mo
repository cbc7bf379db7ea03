within InkLoop.Functions;
package Random "Random numbers that depend only on their position"
  extends Icons.FunctionsPackage;

  annotation (Documentation(info="<html>
<p>
The counter-based generator Philox 4x32-10 of <a href=\"modelica://InkLoop.UsersGuide.References\">[Salmon2011]</a>: a number belongs to a seed, a
stream, a cell and a layer, so the order of the draws does not matter. The FMUs draw the same numbers.
</p>
<p>
A Modelica Integer is only guaranteed to hold 31 bits and has no bitwise operators. The 32-bit words are therefore kept as Reals, which
are exact up to 2<sup>53</sup>, and combined with <code>floor</code> and <code>mod</code>.
</p>
</html>"));
end Random;

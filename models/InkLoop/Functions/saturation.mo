within InkLoop.Functions;
pure function saturation "Share that a neighbour takes of the flow to it on a flat surface"
  extends Icons.Function;

  input Types.Height rise "Height of the cell that is hit, less that of the neighbour";
  input Types.Height width "Downward rise at which the flow ends";
  output Types.Share share "Share that it takes";

algorithm
  share := if rise >= 0 then 1 elseif rise <= -width then 0 else 1 + rise/width;

  annotation (Documentation(info="<html>
<p>
Equation (5) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>: with the rise b and the width w
</p>
<blockquote><p>s = clip(1 + b/w, 0, 1).</p></blockquote>
<p>A lower neighbour takes its whole share, a neighbour higher by w or more takes nothing.</p>
</html>"));
end saturation;

within InkLoop.Types;
record Ink "Heights that one droplet adds to a flat surface"
  Height h1 = 4.4e-6 "Added to the cell that is hit";
  Height h2 = 0.6e-6 "Added to each side neighbour";
  Height h3 = 0.2e-6 "Added to each corner neighbour";
  annotation (
    Documentation(info="<html>
<p>
The heights that one droplet adds to a flat surface, by default those of Table I of
<a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>. In the interior a droplet adds <code>h1 + 4 h2 + 4 h3</code> in all,
whatever the surface. They are peak heights of measured caps, the model's own units: they must not be read as volumes.
</p>
</html>"),
    Icon(graphics={
      Ellipse(extent={{-60,-70},{60,50}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Polygon(points={{-52,10},{0,90},{52,10},{-52,10}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid)}));
end Ink;

within InkLoop.Icons;
partial block Deposition "Icon of a block that prints: a nozzle, a droplet, layers"
  extends Block;
  annotation (
    Documentation(info="<html><p>Icon of a block that prints: a nozzle, a droplet, layers.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Rectangle(extent={{-80,-80},{80,-64}}, lineColor={95,95,95}, fillColor={160,160,164}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-60,-64},{60,-44}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-60,-44},{60,-24}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-60,-24},{0,-4}}, lineColor={28,108,200}, fillColor={180,210,245}, fillPattern=FillPattern.Solid),
      Ellipse(extent={{8,8},{28,28}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Polygon(points={{-8,80},{44,80},{44,56},{24,40},{12,40},{-8,56},{-8,80}}, lineColor={0,0,0}, fillColor={215,215,215}, fillPattern=FillPattern.Solid)}));
end Deposition;

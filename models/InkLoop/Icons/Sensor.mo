within InkLoop.Icons;
partial block Sensor "Icon of a block that measures: a laser over a profile"
  extends Block;
  annotation (
    Documentation(info="<html><p>Icon of a block that measures: a laser over a profile.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Polygon(points={{-80,-80},{-80,-40},{-50,-40},{-30,-16},{30,-16},{50,-40},{80,-40},{80,-80},{-80,-80}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-30,52},{30,80}}, lineColor={0,0,0}, fillColor={215,215,215}, fillPattern=FillPattern.Solid),
      Polygon(points={{0,52},{-34,-16},{34,-16},{0,52}}, lineColor={238,46,47}, fillColor={255,170,170}, fillPattern=FillPattern.Solid)}));
end Sensor;

within InkLoop.Icons;
partial block Controller "Icon of a block that decides: columns up to a target line"
  extends Block;
  annotation (
    Documentation(info="<html><p>Icon of a block that decides: columns up to a target line.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Rectangle(extent={{-76,-76},{-44,24}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-36,-76},{-4,48}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{4,-76},{36,40}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{44,-76},{76,10}}, lineColor={28,108,200}, fillColor={120,170,230}, fillPattern=FillPattern.Solid),
      Line(points={{-84,52},{84,52}}, color={238,46,47}, thickness=1, pattern=LinePattern.Dash)}));
end Controller;

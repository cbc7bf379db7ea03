within InkLoop.Icons;
partial class Information "Icon of a page of the user's guide"
  annotation (
    Documentation(info="<html><p>Icon of a page of the user's guide.</p></html>"),
    Icon(coordinateSystem(preserveAspectRatio=true, extent={{-100,-100},{100,100}}), graphics={
      Ellipse(extent={{-100,-100},{100,100}}, lineColor={28,108,200}, fillColor={28,108,200}, fillPattern=FillPattern.Solid),
      Ellipse(extent={{-14,48},{14,76}}, lineColor={255,255,255}, fillColor={255,255,255}, fillPattern=FillPattern.Solid),
      Rectangle(extent={{-12,-70},{12,30}}, lineColor={255,255,255}, fillColor={255,255,255}, fillPattern=FillPattern.Solid)}));
end Information;

within InkLoop.Control;
block ThresholdFeedback "A droplet wherever at least half a layer is missing"
  extends Interfaces.PartialController;

  parameter Types.Pattern material[nx, ny] = fill(1, nx, ny) "Material of each cell of the part; 0 outside";
  parameter Types.Height target_height[nx, ny] = fill(0, nx, ny) "Nominal height of the part";
  parameter Types.Height layerHeight = 7.6e-6 "Height that a full layer adds in the interior";

equation
  next = {{if target_height[i, j] - measured_height[i, j] >= 0.5*layerHeight then material[i, j] else 0
    for j in 1:ny} for i in 1:nx};

  annotation (
    defaultComponentName="controller",
    Documentation(info="<html>
<p>With the measured height z, the target h_d and the height L of a full layer, cell p is jetted in the next layer when</p>
<blockquote><p>h_d - z &ge; L/2.</p></blockquote>
<h4>Assumptions</h4>
<ul>
<li>The rule looks at each cell separately. It ignores what a droplet gives to its neighbours; only the model knows that.</li>
<li>For an unmeasured cell the rule uses its last valid reading, which the sensor repeats.</li>
</ul>
</html>"));
end ThresholdFeedback;

within InkLoop.Examples;
model TwoMaterials "Two materials side by side, each layer in four passes"
  extends Icons.Example;
  extends BaseClasses.PrintLoop(
    nx=8,
    ny=8,
    redeclare Control.OpenLoop controller(
      nx=nx,
      ny=ny,
      layers_max=3,
      material={{if 2*j <= ny then 1 else 2 for j in 1:ny} for i in 1:nx}),
    redeclare Deposition.LayerDeposition deposition(
      nx=nx,
      ny=ny,
      ink_b(h1=3e-6, h2=0.9e-6, h3=0.3e-6),
      passes=4,
      pass_order=Types.PassOrder.diagonal,
      pass_rotation=1),
    sensor(scan_duration=1));

  annotation (
    experiment(StopTime=5, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
The left half in material A, the right half in a material B that is lower and spreads more. Plot <code>deposition.height[4, 1]</code> to
<code>[4, 8]</code>: the step between the materials grows, and ink of each flows over it.
</p>
</html>"));
end TwoMaterials;

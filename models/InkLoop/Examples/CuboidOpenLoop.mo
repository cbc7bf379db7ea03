within InkLoop.Examples;
model CuboidOpenLoop "Four full layers of a cuboid in open loop"
  extends Icons.Example;
  extends BaseClasses.PrintLoop(controller(layers_max=4), sensor(scan_duration=1));

  annotation (
    experiment(StopTime=6, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
The cuboid of section III-C of <a href=\"modelica://InkLoop.UsersGuide.References\">[Lu2015]</a>: 9 x 9 cells, four layers. Plot
<code>deposition.height[5, 1]</code> to <code>[5, 5]</code>: the edge falls behind the middle, layer by layer, and one cell further inward with every layer.
</p>
</html>"));
end CuboidOpenLoop;

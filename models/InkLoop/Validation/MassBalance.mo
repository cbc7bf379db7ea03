within InkLoop.Validation;
model MassBalance "Heights on the grid and heights lost over its edges add up to the jetted height"
  extends Icons.Example;

  parameter Types.Ink ink_a "Material A";
  parameter Types.Ink ink_b(h1=3e-6, h2=0.9e-6, h3=0.3e-6) "Material B";
  parameter Types.Height uneven[6, 5] = {{5e-6*(1 + sin(7*i + 11*j)) for j in 1:5} for i in 1:6} "Start surface";
  Types.Height jetted = deposition.droplets_a*(ink_a.h1 + 4*ink_a.h2 + 4*ink_a.h3)
    + deposition.droplets_b*(ink_b.h1 + 4*ink_b.h2 + 4*ink_b.h3) "Sum of all droplets";
  Types.Height present = sum(deposition.height) - sum(uneven) "Ink on the grid";
  Types.Height gone = deposition.volume_lost/deposition.pitch^2 "Ink that left it";

  Control.PatternSequence controller(patterns={{{mod(i*j + k, 3) for j in 1:5} for i in 1:6} for k in 1:4}) "Four layers of both materials"
    annotation (Placement(transformation(extent={{-60,-20},{-20,20}})));
  Deposition.LayerDeposition deposition(nx=6, ny=5, height_start=uneven, ink_a=ink_a, ink_b=ink_b, passes=4) "Prints them"
    annotation (Placement(transformation(extent={{20,-20},{60,20}})));

equation
  connect(controller.pattern, deposition.pattern)
    annotation (Line(points={{-18,12},{16,12}}, color={255,127,0}));
  connect(controller.layer_command, deposition.layer_command)
    annotation (Line(points={{-18,-12},{16,-12}}, color={255,127,0}));

  assert(abs(present + gone - jetted) <= 1e-12*(jetted + sum(uneven)), "heights on the grid and heights lost do not add up to what was jetted");

  when deposition.layers_printed >= 4 then
    assert(deposition.droplets_a > 0 and deposition.droplets_b > 0, "one of the materials was not jetted");
    assert(gone > 0, "nothing was lost over the edges, although droplets fell on them");
  end when;

  annotation (
    experiment(StopTime=5, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>Whatever the surface, a droplet adds h1 + 4 h2 + 4 h3: on the grid or beyond its open edges.</p>
</html>"));
end MassBalance;

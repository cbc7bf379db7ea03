within InkLoop.Validation;
model HeightDifferences "Published height differences around a cell between two drops"
  extends Icons.Example;

  parameter Types.Height published[3, 3] =
    1e-6*{{-1.50, -3.41, -1.55}, {6.24, -1.03, 6.12}, {-1.42, -3.77, -1.40}} "Equation (19)";
  parameter Types.Height rmsMax = 0.18e-6 "The measured differences of equal cells differ by up to 0.36 um";
  parameter Types.Height height_scale = 7.0751e-6 "Volume of a drop over the area of a cell";
  parameter Types.Length pitch = 90e-6 "Distance of neighbouring cells";
  parameter Types.Share cap[2, 3] = Functions.capShares(height_scale, 0.6*pitch, pitch) "Shares of a drop: middle, side, corner";
  discrete Types.Height difference[3, 3](each start=0, each fixed=true) "Computed differences";

algorithm
  when sample(0.5, 1) then
    difference := Functions.heightDifference(Functions.coveredHeight(
      height_scale*[cap[1, 2], 2*cap[1, 3], cap[1, 2]; cap[1, 1], 2*cap[1, 2], cap[1, 1]; cap[1, 2], 2*cap[1, 3], cap[1, 2]],
      [cap[2, 2], min(1, 2*cap[2, 3]), cap[2, 2]; cap[2, 1], min(1, 2*cap[2, 2]), cap[2, 1]; cap[2, 2], min(1, 2*cap[2, 3]), cap[2, 2]],
      zeros(3, 3)), 2, 2);
  end when;

equation
  when time >= 0.75 then
    assert(sqrt(sum((difference - published).^2)/9) < rmsMax, "the height differences miss those of equation (19) by more than 0.18 um rms");
  end when;

  annotation (
    experiment(StopTime=1, Tolerance=1e-6, Interval=0.5),
    Documentation(info="<html>
<p>
Equations (7) to (9) and (19) of <a href=\"modelica://InkLoop.UsersGuide.References\">[Wu2024]</a>: two drops lie left and right of the cell that is hit next. A
base radius of the caps of 0.6 pitch is the interpretation that gives the published differences; the range printed in the paper misses them by 3 um.
</p>
</html>"));
end HeightDifferences;

within InkLoop.Sensors;
block ProfileSensor "Height map of a printed layer as a scanning profile sensor measures it"
  extends Interfaces.PartialSensor;

  parameter Types.Length pitch = 263.256e-6 "Distance of neighbouring cells";
  parameter Types.Height noise_std(min=0) = 0 "Standard deviation of the noise of a reading";
  parameter Types.Share noise_correlation = 0 "Share of the noise variance that is common to a whole scan";
  parameter Types.Height resolution(min=0) = 0 "Readings are multiples of this; 0: no rounding";
  parameter Types.Height bias = 0 "Constant error";
  parameter Types.Height drift_rate = 0 "Error that each further scan adds; the first scan has none";
  parameter Types.Slope tilt_x = 0 "Error slope along x about the centre of the grid";
  parameter Types.Slope tilt_y = 0 "Error slope along y about the centre of the grid";
  parameter Types.Length shift_x = 0 "Shift of the scans against the printer along x";
  parameter Types.Length shift_y = 0 "Shift of the scans against the printer along y";
  parameter Types.Length shift_std(min=0) = 0 "Standard deviation of the shift from scan to scan, along each axis";
  parameter Types.Length spot_radius = 0 "Standard deviation of the Gaussian spot; 0: a point";
  parameter Types.Height slope_bias = 0 "Error slope_bias*sin(2*theta) at the local slope angle theta";
  parameter Types.Slope dropout_slope(min=0) = 0 "Cells with a steeper gradient are not valid; 0: off";
  parameter Types.Share dropout_rate = 0 "Probability that a reading is lost";
  parameter Integer seed(min=0) = 0 "Seed of noise and drop-out";

algorithm
  when finished then
    (measured_height, valid) := Functions.readSurface(pre(captured), pre(measured_height), pre(scans), pitch, {shift_x, shift_y}, shift_std, spot_radius,
      slope_bias, noise_std, noise_correlation, dropout_rate, dropout_slope, {tilt_x, tilt_y},
      bias + drift_rate*pre(scans), resolution, seed);
  end when;

  annotation (
    defaultComponentName="sensor",
    Documentation(info="<html>
<p>With the height H of a cell and the number n = 0, 1, 2 ... of the scan:</p>
<pre>
z = mean of H over a Gaussian spot of standard deviation spot_radius,
    at x + shift_x + N(0, shift_std^2) and y + shift_y + N(0, shift_std^2), alike for the whole scan
z = z + slope_bias sin(2 theta),  theta = angle of the local gradient
z = z + N(0, noise_std^2),  the share noise_correlation of the variance common to the scan
lost with probability dropout_rate, and where the gradient exceeds dropout_slope
z = z + tilt_x (x - x_centre) + tilt_y (y - y_centre)
z = z + bias + drift_rate n
z = z rounded to a multiple of resolution
</pre>
<h4>Assumptions</h4>
<ul>
<li>A cell that is not <code>valid</code> repeats its last valid value, at first 0.</li>
<li>At the pitch of droplets slopes are small; drop-out by slope acts at walls only.</li>
</ul>
</html>"));
end ProfileSensor;

within InkLoop.Functions;
pure function readSurface "Readings of a profile sensor on a surface"
  extends Icons.Function;

  input Types.Height height[:, :] "Surface";
  input Types.Height readingBefore[size(height, 1), size(height, 2)] "Last valid readings";
  input Integer scan "Number of the scan, from 0";
  input Types.Length pitch "Distance of neighbouring cells";
  input Types.Length shift[2] "Shift of the scans along x and y";
  input Types.Length shift_std "Standard deviation of the shift from scan to scan";
  input Types.Length spot_radius "Standard deviation of the spot";
  input Types.Height slope_bias "Error per sine of twice the angle of the slope";
  input Types.Height noise_std "Standard deviation of the noise";
  input Types.Share noise_correlation "Share of the noise variance that is common to a scan";
  input Types.Share dropout_rate "Probability that a reading is lost";
  input Types.Slope dropout_slope "Steeper cells are not valid; 0: off";
  input Types.Slope tilt[2] "Slope of the error along x and y";
  input Types.Height offset "Constant error of this scan";
  input Types.Height resolution "Readings are multiples of this; 0: no rounding";
  input Integer seed "Seed of noise and drop-out";
  output Types.Height reading[size(height, 1), size(height, 2)] "Readings; a lost one repeats the last valid one";
  output Boolean valid[size(height, 1), size(height, 2)] "= true, if the cell has been measured";

protected
  Types.Length scatter[2] = if shift_std > 0 then shift_std*{Random.normal(seed, Random.Stream.shift, 0, scan), Random.normal(seed, Random.Stream.shift, 1, scan)} else {0, 0} "Shift of this scan";
  Types.Height spot[size(height, 1), size(height, 2)] = displace(averageOverSpot(height, pitch, spot_radius), (shift + scatter)/pitch) "Mean over the spot";
  Types.Number common = if noise_std > 0 then Random.normal(seed, Random.Stream.commonNoise, 0, scan) else 0 "Noise of the scan";
  Types.Number white = 0 "Noise of the cell";
  Integer cell = 0 "Number of the cell, from 0";
  Types.Slope slope = 0 "Slope at the cell";
  Types.Height value = 0 "Reading of the cell";
  Boolean lost = false "= true, if the reading is lost";

algorithm
  reading := readingBefore;
  valid := fill(true, size(height, 1), size(height, 2));
  for i in 1:size(height, 1) loop
    for j in 1:size(height, 2) loop
      cell := (i - 1)*size(height, 2) + j - 1;
      slope := slopeAt(spot, i, j, pitch);
      white := if noise_std > 0 then Random.normal(seed, Random.Stream.whiteNoise, cell, scan) else 0;
      value := spot[i, j] + slope_bias*2*slope/(1 + slope^2)
        + noise_std*(sqrt(noise_correlation)*common + sqrt(1 - noise_correlation)*white)
        + tilt[1]*pitch*(i - 0.5*(size(height, 1) + 1)) + tilt[2]*pitch*(j - 0.5*(size(height, 2) + 1)) + offset;
      lost := dropout_slope > 0 and slope > dropout_slope;
      if dropout_rate > 0 then
        lost := lost or Random.uniform(seed, Random.Stream.dropout, cell, scan) < dropout_rate;
      end if;
      if not lost then
        reading[i, j] := roundToMultiple(value, resolution);
      end if;
      valid[i, j] := not lost;
    end for;
  end for;

  annotation (Documentation(info="<html>
<p>The errors act in the order of the hardware:</p>
<ol>
<li>the spot takes a Gaussian-weighted mean, shifted against the printer;</li>
<li>a slope of angle t adds <code>slope_bias</code> sin(2 t);</li>
<li>noise, of which a share is common to the scan;</li>
<li>drop-out, at random and where the surface is steep;</li>
<li>tilt about the centre of the grid, and an offset;</li>
<li>steps of the resolution.</li>
</ol>
</html>"));
end readSurface;

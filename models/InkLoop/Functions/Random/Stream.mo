within InkLoop.Functions.Random;
package Stream "Streams of random numbers"
  extends Icons.Package;

  constant Integer droplet = 1 "Volume of a droplet";
  constant Integer cell = 2 "Volume of the droplets of a cell";
  constant Integer layer = 3 "Volume of the droplets of a layer";
  constant Integer nozzle = 4 "Volume of the droplets of a nozzle";
  constant Integer whiteNoise = 5 "Noise of a reading";
  constant Integer commonNoise = 6 "Noise of a scan";
  constant Integer dropout = 7 "Loss of a reading";
  constant Integer shift = 8 "Shift of a scan";

  annotation (Documentation(info="<html><p>Streams with different numbers are independent.</p></html>"));
end Stream;

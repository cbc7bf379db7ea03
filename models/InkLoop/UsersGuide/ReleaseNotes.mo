within InkLoop.UsersGuide;
class ReleaseNotes "Release notes"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<h4>Version 0.2.0</h4>
<p>Scans that lie beside the part (<code>shift_x</code>, <code>shift_y</code>, <code>shift_std</code> of the profile sensor). Names within
functions follow the Modelica Standard Library; <code>layer_height</code> of the threshold feedback is <code>layerHeight</code> (a conversion
is part of the library). Reference results of the examples; icons of the packages.</p>
<h4>Version 0.1.0</h4>
<p>First version: Lu's layer model in one and two materials, one and four passes; Wu and Chiu's volume and area propagation; the profile
sensor; open loop and threshold feedback.</p>
</html>"));
end ReleaseNotes;

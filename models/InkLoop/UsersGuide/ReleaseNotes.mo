within InkLoop.UsersGuide;
class ReleaseNotes "Release notes"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<h4>Version 0.1.0</h4>
<p>First version: Lu's layer model in one and two materials, one and four passes; Wu and Chiu's volume and area propagation; the profile
sensor; open loop and threshold feedback.</p>
</html>"));
end ReleaseNotes;

within InkLoop.UsersGuide;
class Contact "Contact and licence"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<p>
The library is part of the project inkloop and written by its authors. Questions and faults go to them, where the project is kept.
</p>
<p>Licence: BSD-3-Clause, as the whole project; its text is the file LICENSE of the project.</p>
</html>"));
end Contact;

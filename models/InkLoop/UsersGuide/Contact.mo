within InkLoop.UsersGuide;
class Contact "Contact and licence"
  extends Icons.Information;

  annotation (
    DocumentationClass=true,
    Documentation(info="<html>
<p>
The library is part of the project inkloop and written by its authors. Please send questions and bug reports to them, through the repository of the project.
</p>
<p>Licence: BSD-3-Clause, as the whole project; its text is the file LICENSE of the project.</p>
</html>"));
end Contact;

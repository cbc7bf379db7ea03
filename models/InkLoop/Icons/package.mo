within InkLoop;
package Icons "Icons"
  extends Icons.Package;

  annotation (Documentation(info="<html><p>Icons that the classes of the library extend.</p></html>"));
end Icons;

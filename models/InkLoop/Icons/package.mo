within InkLoop;
package Icons "Icons"
  extends Icons.IconsPackage;

  annotation (Documentation(info="<html><p>Icons that the classes of the library extend.</p></html>"));
end Icons;

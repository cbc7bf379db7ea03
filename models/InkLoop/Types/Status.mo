within InkLoop.Types;
package Status "Codes of the output status"
  extends Icons.Package;

  constant Integer idle = 0 "Nothing to do";
  constant Integer busy = 1 "A layer is being printed, a surface is being scanned";
  constant Integer done = 2 "Controller: the print is finished";

  annotation (Documentation(info="<html>
<p>
Whole numbers instead of an enumeration: the codes are those of the FMUs and start at 0. The FMUs and the devices know two more,
3 (fault) and 4 (untrusted), which this library does not use.
</p>
</html>"));
end Status;

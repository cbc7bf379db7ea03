within InkLoop.Types;
type Status = enumeration(
    idle "Nothing to do",
    busy "A layer is being printed, a surface is being scanned",
    done "Controller: the print is finished") "State of a component of the loop"
  annotation (Documentation(info="<html>
<p>
The FMUs number the states from 0, so that their number is <code>Integer(status) - 1</code>. The FMUs and the devices know two more,
3 (fault) and 4 (untrusted), which this library does not use.
</p>
</html>"));

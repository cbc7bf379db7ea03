within InkLoop;
package Validation "Published numbers and laws, as assertions"
  extends Icons.Package;

  annotation (Documentation(info="<html>
<p>Models that stop with a message when a published number or a law does not come out.</p>
</html>"));
end Validation;

within InkLoop;
package Validation "Published numbers and invariants, as assertions"
  extends Icons.ExamplesPackage;

  annotation (Documentation(info="<html>
<p>Models that stop with a message when a published number is not reproduced or an invariant is violated.</p>
</html>"));
end Validation;

within InkLoop.Types;
type VariationKind = enumeration(
    per_droplet "A new factor for each droplet",
    per_cell "One factor for each cell and the whole print",
    per_layer "One factor for each layer",
    per_cell_and_layer "Product of the last two") "Scope of one random volume factor"
  annotation (Documentation(info="<html><p>The scope of one random volume factor.</p></html>"));

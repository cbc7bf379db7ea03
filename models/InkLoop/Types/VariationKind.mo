within InkLoop.Types;
type VariationKind = enumeration(
    per_droplet "A new factor for each droplet",
    per_cell "One factor for each cell and the whole print",
    per_layer "One factor for each layer",
    per_cell_and_layer "Product of the last two") "What one random volume factor belongs to"
  annotation (Documentation(info="<html><p>What one random volume factor belongs to.</p></html>"));

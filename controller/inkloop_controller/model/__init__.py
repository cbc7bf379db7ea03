"""The prediction model of a layer, and what may be jetted where."""

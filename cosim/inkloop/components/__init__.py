"""From the `kind` of a scenario table to a component of the loop."""

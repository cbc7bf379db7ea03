"""Results of a run: storage, metrics and checkpoints."""

SURFACES = ("printed", "measured", "estimated", "target")
"""Maps of a run that are exported and evaluated as surfaces."""

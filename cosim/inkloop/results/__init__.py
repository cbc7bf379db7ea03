"""Results of a run: storage, metrics and checkpoints."""

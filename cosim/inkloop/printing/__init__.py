"""Print a scenario into a run folder, and resume an interrupted run."""

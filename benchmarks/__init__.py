"""Measured comparisons: ours against a peer in the same run, printed as ratios. `make benchmarks` runs them all."""

"""Measured comparisons: ours against a peer in the same run, printed as ratios. `make benchmarks` runs them all."""

import sys
from pathlib import Path

# The peers in NumPy are the evaluations that the tests compare with.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

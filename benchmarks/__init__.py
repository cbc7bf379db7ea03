"""Measured comparisons: ours against peers in the same run and against what is to be reached. `make benchmarks` runs
them all in some ten minutes."""

import sys
from pathlib import Path

# The peers in NumPy are the evaluations that the tests compare with.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

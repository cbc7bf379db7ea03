"""Measured comparisons: ours against floors and peers in the same run, and against targets."""

import sys
from pathlib import Path

# The peers in NumPy are the evaluations that the tests compare with.
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

"""Parts in space: analytic shapes, and columns of height intervals that anything else becomes."""

from inkloop.geometry.cells import cell_centers
from inkloop.geometry.columns import Columns
from inkloop.geometry.shapes import TOLERANCE_M, Cuboid, Cylinder, PipeJunction, Shape, Staircase, contained

__all__ = [
    "TOLERANCE_M",
    "Columns",
    "Cuboid",
    "Cylinder",
    "PipeJunction",
    "Shape",
    "Staircase",
    "cell_centers",
    "contained",
]

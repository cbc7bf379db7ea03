"""Parts in space: analytic shapes, and columns of height intervals, made from meshes, images and combinations.

The libraries that read meshes are imported when `load` meets their format.
"""

from inkloop.geometry.body import Placement
from inkloop.geometry.columns import Columns, cell_centers
from inkloop.geometry.mesh import load, load_inks
from inkloop.geometry.overhang import Overhangs, overhangs, resting, support_below
from inkloop.geometry.shapes import TOLERANCE_M, Cuboid, Cylinder, PipeJunction, Shape, Staircase, contained

__all__ = [
    "TOLERANCE_M",
    "Columns",
    "Cuboid",
    "Cylinder",
    "Overhangs",
    "PipeJunction",
    "Placement",
    "Shape",
    "Staircase",
    "cell_centers",
    "contained",
    "load",
    "load_inks",
    "overhangs",
    "resting",
    "support_below",
]

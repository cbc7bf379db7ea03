"""The deposition models as functions of arrays: the C kernels of the FMUs, called from Python.

Every model has `start`, which makes its surface from the heights of the cells, and `layer`, which prints one layer on
it and returns the new surface; `height` of a surface, the mean over each cell, is common to all models.
"""

from inkloop_lab.models.layer_deposition import DropletVolumes, LayerDeposition, SuperpositionDeposition
from inkloop_lab.models.volume_area_deposition import VolumeAreaDeposition
from inkloop_lab.models.young_laplace_deposition import YoungLaplaceDeposition

__all__ = [
    "DropletVolumes",
    "LayerDeposition",
    "SuperpositionDeposition",
    "VolumeAreaDeposition",
    "YoungLaplaceDeposition",
]

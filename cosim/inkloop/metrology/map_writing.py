"""Write height maps for metrology tools; `read` gives the same map back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO

import numpy as np

from inkloop.errors import require
from inkloop.files import replaced
from inkloop.metrology.height_map import HeightMap
from inkloop.metrology.x3p_writing import write_x3p
from inkloop.units import M_PER_CM, UM_PER_M


def write(path: Path, map_: HeightMap, form: str) -> None:
    """Write a map whole or not at all; a pixel without a height is NaN in every format. Raises OSError,
    InkloopError where the library of a format is missing.

    form: "npy" (float64 in m, first index along x), "tiff" (float32 in um), "sdf" and "x3p" (float64 in m); in the last
    three a row lies along x and the first one is y = 0.
    """
    with replaced(path) as partial, partial.open("wb") as file:
        _WRITERS[form](file, map_)


def _npy(file: BinaryIO, map_: HeightMap) -> None:
    """The array alone: neither unit nor size of a pixel."""
    np.save(file, map_.z)


def _tiff(file: BinaryIO, map_: HeightMap) -> None:
    """With pixels per centimetre, and ImageJ's description, which has a unit for the heights."""
    require("tifffile", "a TIFF file").imwrite(
        file,
        (map_.z.T * UM_PER_M).astype(np.float32),
        imagej=True,
        resolution=(M_PER_CM / map_.dx, M_PER_CM / map_.dy),
        resolutionunit="CENTIMETER",
        metadata={"unit": "cm", "vunit": "um"},
    )


def _sdf(file: BinaryIO, map_: HeightMap) -> None:
    """ISO 25178-71, binary."""
    sdfio = require("sdfio", "an SDF file")
    metadata = sdfio.Metadata(manufacturer_id="inkloop")
    sdfio.write(file, map_.z.T, x_scale=map_.dx, y_scale=map_.dy, z_scale=1.0, metadata=metadata)


_WRITERS: Mapping[str, Callable[[BinaryIO, HeightMap], None]] = {
    "npy": _npy,
    "tiff": _tiff,
    "sdf": _sdf,
    "x3p": write_x3p,
}

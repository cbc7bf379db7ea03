"""Height maps in formats that carry their own units: SDF, and through SurfaceTopography those of instruments."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from inkloop.errors import HeightMapError
from inkloop.metrology.file_contents import FileContents, length_factor


def read_sdf(path: Path) -> FileContents:
    """A surface of ISO 25178-71, as text or binary. Raises HeightMapError, OSError."""
    import sdfio

    try:
        surface = sdfio.read(path)
    except (sdfio.SdfError, ValueError) as error:
        raise HeightMapError(f"{path}: is no SDF file as ISO 25178-71 has it ({error})") from error
    pixel = float(surface.header.x_scale), float(surface.header.y_scale)
    return FileContents(np.asarray(surface.data, np.float64), "m", pixel)


def read_instrument(path: Path) -> FileContents:
    """The first map in a file of an instrument: SUR, X3P, GWY, VK, OPD ... Raises HeightMapError, OSError."""
    from SurfaceTopography import read_topography

    try:
        topography = read_topography(str(path))
        heights = np.ma.filled(topography.heights().astype(np.float64), np.nan)
        unit, sizes = topography.unit, topography.physical_sizes
    except Exception as error:  # each of its readers fails in its own way, on bytes of unknown origin
        raise HeightMapError(f"{path}: SurfaceTopography cannot read it ({_first_line(error)})") from error
    if heights.ndim != 2:
        raise HeightMapError(f"{path}: holds a line of {heights.size} heights; expected a map")
    factor = None if unit is None else length_factor(str(unit))
    pixel = None if factor is None or sizes is None else tuple(np.asarray(sizes) * factor / heights.shape)
    return FileContents(heights, unit, None if pixel is None else (float(pixel[0]), float(pixel[1])), rows_along="y")


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0]

"""A surface of a run as a height map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from inkloop.contract import HEIGHT, MEASURED_HEIGHT, VALID
from inkloop.errors import ResultError
from inkloop.metrology.height_map import HeightMap
from inkloop.results import SURFACES

if TYPE_CHECKING:
    import xarray as xr

_MAPS: Mapping[str, str] = dict(
    zip(SURFACES, (HEIGHT, MEASURED_HEIGHT, "estimated_height", "target_height"), strict=True)
)
"""Surface -> its map in a result."""


def surface(
    run: xr.Dataset, source: str, *, name: str = SURFACES[0], layer: int | None = None, part: bool = False
) -> HeightMap:
    """The surface `name` of a run after `layer` layers, None for the last one; NaN in cells that have no height there.

    name: one of SURFACES. Cells without a height are those that the scan did not measure, where the map is a scan or
    was taken from one, and, if `part`, those outside the part. Raises ResultError that names the maps and layers that
    exist.
    """
    key = _MAPS[name]
    if key not in run:
        known = ", ".join(one for one in SURFACES if _MAPS[one] in run)
        raise ResultError(f"{source}: holds no {name} surface; it has {known or 'none'}")
    last = run.sizes["layer"] - 1
    number = last if layer is None else layer
    if not 0 <= number <= last:
        raise ResultError(f"{source}: holds no layer {number}; it has layers 0 (the start surface) to {last}")
    values = run[key]
    heights = (values[number] if "layer" in values.dims else values).values.astype(np.float64)
    if VALID in run and MEASURED_HEIGHT in (key, values.attrs.get("source")):
        heights = np.where(run[VALID].values[number].astype(bool), heights, np.nan)
    if part:
        heights = np.where(run["mask"].values.astype(bool), heights, np.nan)
    pitch = float(run.attrs["pitch"])
    title = f"{name} surface" if "layer" not in values.dims else f"{name} surface after layer {number}"
    return HeightMap(heights, pitch, pitch, source=f"{source}: {title}")

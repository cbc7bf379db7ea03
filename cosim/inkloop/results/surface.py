"""A surface of a run as a height map, and its evaluation with part, target, start surface and droplets of the run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from inkloop.contract import HEIGHT, MEASURED_HEIGHT, VALID
from inkloop.errors import ResultError
from inkloop.metrology.evaluation.definitions import DEFINITIONS, Evaluation
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.table import Parameter, evaluate
from inkloop.metrology.height_map import HeightMap
from inkloop.results import SURFACES
from inkloop.results.attributes import Meaning, variable

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


def subject_of(run: xr.Dataset, source: str, *, name: str = SURFACES[0], layer: int | None = None) -> Subject:
    """Subject of `inkloop metrology`: a surface of a run after `layer` layers, None for the last one.

    name: one of SURFACES. Raises ResultError.
    """
    number = run.sizes["layer"] - 1 if layer is None else layer
    counts = [run[count] for count in ("droplets_a", "droplets_b") if count in run]
    return Subject(
        surface(run, source, name=name, layer=layer),
        run["mask"].values.astype(bool),
        target=run["target_height"].values,
        start=surface(run, source, layer=0).z if HEIGHT in run else None,
        droplets=sum(int(count[number]) for count in counts) if counts else None,
    )


def with_parameters(run: xr.Dataset, wanted: Evaluation) -> xr.Dataset:
    """The run with a variable for each wanted parameter: of the last layer, or by layer; NaN where it was refused.

    The attribute `refused` is the reason, `treatment` what was done to the heights. A run without a printed surface is
    returned as it is.
    """
    if HEIGHT not in run:
        return run
    layers = range(run.sizes["layer"]) if wanted.every_layer else (run.sizes["layer"] - 1,)
    table = [evaluate(subject_of(run, "run", layer=layer), wanted) for layer in layers]
    dims = ("layer",) if wanted.every_layer else ()
    added = {}
    for column in zip(*table, strict=True):
        last = column[-1]
        values = np.array([parameter.value for parameter in column]) if dims else np.float64(last.value)
        others = {"treatment": wanted.treatment.of(DEFINITIONS[last.symbol].group)}
        meaning = Meaning(f"{last.name} of the printed surface over the part", others=others)
        added[last.symbol] = variable(last.symbol, dims, values, last.unit, meaning)
        if last.reason:
            added[last.symbol].attrs["refused"] = last.reason
    return run.assign(added)


def parameters_of(run: xr.Dataset) -> tuple[Parameter, ...]:
    """The parameters of the last layer that a run holds, in order."""
    held = [symbol for symbol in DEFINITIONS if symbol in run and "treatment" in run[symbol].attrs]
    return tuple(
        Parameter(
            symbol,
            DEFINITIONS[symbol].name,
            float(run[symbol][-1] if run[symbol].dims else run[symbol]),
            run[symbol].attrs["units"],
            run[symbol].attrs.get("refused", ""),
        )
        for symbol in held
    )

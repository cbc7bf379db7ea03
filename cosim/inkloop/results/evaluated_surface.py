"""The surface of a run with what the run knows of it: part, target, start surface and droplets."""

from __future__ import annotations

from typing import TYPE_CHECKING

from inkloop.contract import HEIGHT
from inkloop.metrology.evaluation.subject import Subject
from inkloop.results import SURFACES
from inkloop.results.surface import surface

if TYPE_CHECKING:
    import xarray as xr


def subject_of(run: xr.Dataset, source: str, *, name: str = SURFACES[0], layer: int | None = None) -> Subject:
    """What `inkloop metrology` evaluates: a surface of a run after `layer` layers, None for the last one.

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

"""Errors of a surface against its target, over the cells of the part.

An error is target minus height everywhere: what is still to be printed, as in control. Where it is positive, the part
is too low.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job
from inkloop.units import UM_PER_M

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["MEAN_ERROR", "SIGN", "surface_error", "without_sign"]

TOO_LOW, TOO_HIGH = "too low", "too high"
MEAN_ERROR = "mean_error"
"""The metric that has a sign."""
SIGN = f"{TOO_LOW} +, {TOO_HIGH} -"
"""Meaning of the sign of an error, for labels and headings."""


@dataclass(frozen=True)
class SurfaceError:
    """Error = target - height over the part [m]: mean, mean absolute, root mean square, population std, extremes."""

    mean_error: float
    mae: float
    rms: float
    std: float
    min: float
    max: float


def surface_error(height: FloatMap, job: Job) -> SurfaceError:
    """Errors of a surface (nx, ny) [m] against the job's target."""
    return masked_error(height, job.target_height, job.mask)


def masked_error(height: FloatMap, target: FloatMap, mask: BoolMap) -> SurfaceError:
    """Errors of `height` against `target` where `mask` is true; all (nx, ny), heights in metres."""
    error = (target - height)[mask]
    return SurfaceError(
        mean_error=float(error.mean()),
        mae=float(np.abs(error).mean()),
        rms=float(np.sqrt(np.square(error).mean())),
        std=float(error.std()),
        min=float(error.min()),
        max=float(error.max()),
    )


def without_sign(metric: str, values: Iterable[float]) -> list[float]:
    """Values of a metric of prints, for their mean: of `mean_error`, whose signs would cancel, the absolute values."""
    return [abs(value) if metric == MEAN_ERROR else value for value in values]


def error_of(run: xr.Dataset) -> FloatMap:
    """Target minus final height of a run [um], NaN outside the part."""
    error: FloatMap = run.target_height.values - run.height[-1].values
    error *= UM_PER_M
    error[~run.mask.values.astype(bool)] = np.nan
    return error

"""How far a surface is from its target, over the cells of the part."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job


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

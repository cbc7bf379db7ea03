"""Prediction of each scan from the previous scan by a deposition model, and its error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.identify.surface_filter import start_surface
from inkloop_lab.models import (
    LayerDeposition,
    SuperpositionDeposition,
    VolumeAreaDeposition,
    YoungLaplaceDeposition,
)
from inkloop_lab.models.volume_area_deposition import InkSurface

Model: TypeAlias = LayerDeposition | SuperpositionDeposition | VolumeAreaDeposition | YoungLaplaceDeposition
Marks: TypeAlias = NDArray[np.bool_]

GROWN = 0.1  # share of a full layer: lower cells do not count in (21), which divides by the height (assumed)


@dataclass(frozen=True)
class Score:
    """rms: of scan less prediction [m]; relative: (21) of Wu, Chiu 2024, relative to the measured height over the start
    surface, of cells that are at least a tenth of a layer high, within one cell of a droplet of the layer.
    """

    rms: float
    relative: float  # NaN if no cell is that high


def predictions(model: Model, record: PrintRecord, noise_std: float = 0.0) -> NDArray[np.float64]:
    """(layers, nx, ny) [m]: the surface after each layer from the scan before it; cells that it did not see have the
    height predicted before. The covered area is followed by the model where it was not measured.
    """
    ground, _ = start_surface(record.measured[0], noise_std)
    before = np.where(np.isfinite(record.measured[0]), record.measured[0], ground)
    area = np.zeros(record.shape)
    found = []
    for layer in record.layers():
        if isinstance(model, VolumeAreaDeposition):
            printed = model.layer(_ink_surface(ground, before, area), layer.pattern, layer.number)
            after, area = printed.height, printed.area
            if record.area is not None:
                area = np.clip(record.area[layer.number], 0.0, 1.0)
        else:
            after = _printed(model, before, layer.pattern, layer.number)
        found.append(after)
        before = np.where(np.isfinite(layer.after), layer.after, after)
    return np.stack(found)


def _ink_surface(ground: FloatMap, height: FloatMap, area: FloatMap) -> InkSurface:
    """A measured surface as volumes and areas: noise neither makes ink negative nor a covered part higher than the
    highest cell.
    """
    ink = np.maximum(height - ground, 0.0)
    tallest = float(ink.max())
    return InkSurface(ground, ground + ink, np.maximum(area, ink / tallest) if tallest > 0.0 else area)


def _printed(
    model: LayerDeposition | SuperpositionDeposition | YoungLaplaceDeposition,
    before: FloatMap,
    pattern: NDArray[np.int32],
    number: int,
) -> FloatMap:
    if isinstance(model, YoungLaplaceDeposition):
        return model.layer(model.start(before), pattern, number).height
    return model.layer(model.start(before), pattern, number).height


def score(
    records: Sequence[PrintRecord],
    predicted: Sequence[NDArray[np.float64]],
    cells: Sequence[Marks],
    layer_height: float,
    noise_std: float,
) -> Score:
    """Over the given cells (nx, ny) of all layers of all prints; `predicted` as from `predictions`."""
    errors, shares = [], []
    for record, after, mask in zip(records, predicted, cells, strict=True):
        ground, _ = start_surface(record.measured[0], noise_std)
        scans = record.measured[1:]
        seen = np.isfinite(scans) & mask
        error = scans - after
        errors.append(error[seen])
        counted = seen & near_droplets(record.pattern) & (scans - ground > GROWN * layer_height)
        shares.append((error / np.where(counted, scans - ground, 1.0))[counted])
    return Score(rms(np.concatenate(errors)), rms(np.concatenate(shares)))


def near_droplets(pattern: NDArray[np.int32]) -> Marks:
    """(layers, nx, ny): within one cell of a droplet of the layer."""
    nx, ny = pattern.shape[1:]
    padded = np.pad(pattern > 0, ((0, 0), (1, 1), (1, 1)))
    shifted = [padded[:, di : di + nx, dj : dj + ny] for di in range(3) for dj in range(3)]
    return np.asarray(np.logical_or.reduce(shifted))


def rms(values: NDArray[np.float64]) -> float:
    """Root of the mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")

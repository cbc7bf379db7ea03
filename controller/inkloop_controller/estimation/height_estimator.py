"""Estimate the surface, the ink and the scans from what was read, as the planner's initial state."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop.component_errors import error_of_form
from inkloop.contract import MEASURED_HEIGHT
from inkloop_controller.core.bindings import answered
from inkloop_controller.core.layer_step import Block, LayerStep
from inkloop_controller.core.library import library
from inkloop_controller.estimation.estimate_figures import EstimateFigures, FiguresStruct
from inkloop_controller.problem.arrays import checked, checked_droplets, first_cell, pointer
from inkloop_controller.problem.horizon_problem import IntMap
from inkloop_controller.problem.options import declared, default, errors_of, refuse, variables

InkModel: TypeAlias = Literal["scale", "full", "off"]
"""Learnt properties of each ink: its droplet volume; h1, h2 and h3 as far as the patterns separate them; nothing."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate after a scan.

    height: (nx, ny) [m]; height_variance: (nx, ny) of its error [m^2]; inks: what their droplets really add; dead,
    capped: (nx, ny) cells whose droplets do not come, and that are given no more ink; figures: what is reported; block:
    the bytes that C keeps of it, None for a surface that is known for sure.
    """

    height: FloatMap
    height_variance: FloatMap
    inks: tuple[Ink, ...]
    dead: BoolMap
    capped: BoolMap
    figures: EstimateFigures
    block: Block | None = None

    @classmethod
    def exact(cls, height: FloatMap, inks: tuple[Ink, ...]) -> Estimate:
        """A surface (nx, ny) [m] and inks that are known for sure."""
        none = np.zeros(height.shape, np.bool_)
        return cls(height, np.zeros(height.shape), inks, none, none, EstimateFigures())

    @property
    def ink_scale(self) -> float:
        """Volume of the inks as a share of the nominal one, mean over the inks."""
        return self.figures.volume

    @property
    def state(self) -> Mapping[str, NDArray[Any]]:
        """The maps (nx, ny) in `block` by the names of SurfaceEstimate in C, and `known`, which only C reads."""
        return {} if self.block is None else _maps_of(self.block, self.height.shape)


_MAPS: Mapping[str, str] = {
    "height": "f8", "height_variance": "f8", "ledger": "f8", "last": "f8", "surprise": "f8", "dead_evidence": "f8",
    "unseen": "i4", "last_valid": "u1", "surprised": "u1", "capped": "?",
}  # fmt: skip
"""Types of the maps of an estimate, in the order of `SurfaceEstimate`, as they lie behind what is known besides."""


def _maps_of(block: Block, shape: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    place = int(library().inkloop_knowledge_size())
    maps: dict[str, NDArray[Any]] = {"known": block[:place]}
    for name, dtype in _MAPS.items():
        end = place + shape[0] * shape[1] * np.dtype(dtype).itemsize
        maps[name], place = block[place:end].view(dtype).reshape(shape), end
    return maps


class HeightEstimator:
    """The observer: surface, ink and geometry of the scans, from scan to scan.

    The method is described in controller/core/observer/observer.h. A reading has the variance
    sensor_noise_std^2 + sensor_resolution^2 / 12 [m^2]; without sensor_noise_std the noise is what the unprinted cells
    show. untrusted_layers: as many a cell may live on prediction alone; register_scans: the geometry of the scans is
    looked for; flat_ground: layer 0 is flat, of height 0 (None: where the job has no other start surface);
    volume_least, volume_most: of the droplets, as a share of the nominal ones, that are believed; drop_levels: largest
    number of drops of a droplet; take_as_read: nothing is estimated; threads: the estimate is the same for any number.
    Raises ValueError for invalid options.
    """

    def __init__(
        self,
        job: Job,
        *,
        adapt_ink: Annotated[InkModel, declared("adapt_ink")] = default("adapt_ink"),
        sensor_noise_std: Annotated[float | None, declared("sensor_noise_std")] = default("sensor_noise_std"),
        sensor_resolution: Annotated[float, declared("sensor_resolution")] = default("sensor_resolution"),
        untrusted_layers: Annotated[int, declared("untrusted_layers")] = default("untrusted_layers"),
        register_scans: Annotated[bool, declared("register_scans")] = default("register_scans"),
        flat_ground: Annotated[bool | None, declared("flat_ground")] = default("flat_ground"),
        volume_least: Annotated[float, declared("volume_least")] = default("volume_least"),
        volume_most: Annotated[float, declared("volume_most")] = default("volume_most"),
        drop_levels: int = 1,
        take_as_read: bool = False,
        threads: int = 1,
    ) -> None:
        options: dict[str, Any] = {
            "adapt_ink": adapt_ink,
            "sensor_noise_std": sensor_noise_std,
            "sensor_resolution": sensor_resolution,
            "untrusted_layers": untrusted_layers,
            "register_scans": register_scans,
            "flat_ground": job.height_start is None if flat_ground is None else flat_ground,
            "volume_least": volume_least,
            "volume_most": volume_most,
        }
        refuse(errors_of(**options, drop_levels=drop_levels, threads=threads))
        self.options = {**options, "drop_levels": drop_levels, "take_as_read": bool(take_as_read), "threads": threads}
        self._step = LayerStep(job, **self.options)
        self._shape, self._inks = (job.nx, job.ny), len(job.inks)

    def first(self, measured: FloatMap, valid: BoolMap, layer: int = 0) -> Estimate:
        """The surface on which the print begins, that of layer number `layer`.

        A cell that was not measured counts as bare substrate, height 0, give or take a layer. Raises ValueError if less
        than 2 % of the cells were.
        """
        after, (scan, seen) = self._step.new_estimate(), self.scan(measured, valid)
        given = (self._step.struct, layer, pointer(scan), pointer(seen), pointer(after))
        answered(library().inkloop_estimate_first(*given))
        return self.estimate(after)

    def next(
        self,
        before: Estimate,
        pattern: IntMap,
        layer: int,
        measured: FloatMap,
        valid: BoolMap,
        factor: FloatMap | None = None,
        *,
        is_unknown: bool = False,
    ) -> Estimate:
        """Layer number `layer` (from 1) was printed as `pattern` and scanned: measured (nx, ny) [m], where valid.

        factor: (nx, ny) volume of each droplet [1]; is_unknown: the layer was aborted at an unknown place: the scan
        counts, nothing is learnt. If memory runs out, the estimate before stays as it was.
        """
        scan, seen = self.scan(measured, valid)
        jetted, volumes = checked_droplets(pattern, factor, self._shape, self._inks)
        of_droplets = pointer(jetted), None if volumes is None else pointer(volumes)
        known, after = pointer(self._known(before)), self._step.new_estimate()
        given = (self._step.struct, known, *of_droplets, layer, is_unknown, pointer(scan), pointer(seen))
        answered(library().inkloop_estimate_next(*given, pointer(after)))
        return self.estimate(after)

    def trust_again(self, estimate: Estimate) -> Estimate:
        """The same after a person has looked: the print goes on, and the next scan is taken as it is."""
        if estimate.block is None:
            return estimate
        after = estimate.block.copy()
        library().inkloop_trust_again(pointer(after), self._shape[0] * self._shape[1])
        return self.estimate(after)

    def estimate(self, block: Block) -> Estimate:
        """An estimate from its bytes. Raises ValueError for those of another grid."""
        whole = checked("block", block, "u1", (self._step.estimate_size,))
        maps, dead, found = _maps_of(whole, self._shape), np.empty(self._shape, np.bool_), FiguresStruct()
        library().inkloop_estimate_figures(self._step.struct, pointer(whole), ctypes.byref(found), pointer(dead))
        return Estimate(
            height=maps["height"],
            height_variance=maps["height_variance"],
            inks=tuple(Ink(ink.h1, ink.h2, ink.h3) for ink in found.ink[: self._inks]),
            dead=dead,
            capped=maps["capped"],
            figures=EstimateFigures.of_struct(found),
            block=whole,
        )

    def scan(self, measured: FloatMap, valid: BoolMap) -> tuple[FloatMap, BoolMap]:
        """A scan for C; what was not seen is never looked at, and may be no number.

        Raises ValueError for maps of another shape or type, and for a reading that is seen and no height in metres.
        """
        seen = checked("valid", valid, "?", self._shape)
        if error := error_of_form(MEASURED_HEIGHT, measured, "f8", self._shape):
            raise ValueError(error)
        heights, most = measured if seen.all() else np.where(seen, measured, 0.0), variables()[MEASURED_HEIGHT].max
        if not (heights.min() >= -most and heights.max() <= most):
            i, j = first_cell(~(np.abs(heights) <= most))
            raise ValueError(
                f"{MEASURED_HEIGHT} is {heights[i, j]:g} at cell ({i}, {j}), which is marked valid; needs a height in "
                f"metres, within {most:g} m, or valid = false"
            )
        return np.ascontiguousarray(heights), seen

    def _known(self, estimate: Estimate) -> Block:
        if estimate.height.shape != self._shape:
            raise ValueError(f"height has shape {estimate.height.shape}; needs {self._shape}")
        if estimate.block is None:
            raise ValueError("the estimate before has no state; needs one that `first` or `next` has returned")
        return estimate.block

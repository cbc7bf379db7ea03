"""Estimate the surface, the ink and the scans from what was read, as the planner's initial state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from enum import IntFlag
from functools import cached_property
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller.core.bindings import answered, checked, ink_pair, laid_out, layer_struct, pointer
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import EstimateStruct, EstimatorOptionsStruct, FiguresStruct, InkPriorStruct
from inkloop_controller.model.layer_model import LayerModel
from inkloop_controller.model.regions import nominal_layer_height
from inkloop_controller.problem.horizon_problem import IntMap
from inkloop_controller.problem.options import Length, Option

InkModel: TypeAlias = Literal["scale", "full", "off"]
"""What is learnt of each ink: its droplet volume; h1, h2 and h3 as far as the patterns separate them; nothing."""

INK_MODELS: Mapping[InkModel, int] = {"scale": 1, "full": 2, "off": 3}
"""Their numbers in surface_estimate.h."""

SENSOR_NOISE = Option(
    unit="um",
    meaning="standard deviation of a reading; 0: readings are exact",
    absent="estimated from the cells that are not printed",
    form=Length | None,
)
REGISTERED = Option(
    meaning="find shift, rotation, magnification and spot of the scans, and correct scans for them once they explain "
    "what was read; false where fiducials register the profiler: then what is found is the placement of droplets"
)
FLAT_GROUND = Option(
    meaning="layer 0 is flat, of height 0: the first scan shows how the profiler is levelled",
    absent="where the scenario has no `[substrate]`",
    form=bool | None,
)
VOLUME_LEAST = Option(
    meaning="least volume of the droplets, as a share of the nominal one, that is believed; less stops the print",
    form=Annotated[float, Field(ge=0.01, le=1.0)],
)
VOLUME_MOST = Option(
    meaning="largest volume of the droplets that is believed; more stops the print",
    form=Annotated[float, Field(ge=1.0, le=100.0)],
)
DROPLET_STD = 0.1  # of a droplet's volume about its mean [1], as in controller/core/observer/surface_estimate.h
DEAD_EVIDENCE = 15.0  # from here on a cell is dead
UNSURE = 0.3  # layers: standard deviation of a height that is not known, as in scan_doubts.c
PROBE_LAYERS = 5  # every so many layers the dead cells are tried again (assumed)


class UntrustedReason(IntFlag):
    """Why the status is untrusted; from NO_GROWTH on the print is stopped."""

    UNSEEN = 1  # cells of the part have lived on prediction for too many layers
    BLIND = 2  # most of the part was not measured in the last scans
    GROUND = 4  # the first scan shows ground that is called flat far from height 0
    RESIDUALS = 8  # scans differ from predictions by more than droplets and sensor explain
    INK = 16  # cells are capped: by the droplets given to them they are high enough
    HIGH = 32  # cells stand higher than they are to
    NO_GROWTH = 64  # nothing grew where droplets were jetted
    SAME_SCAN = 128  # the sensor shows an earlier scan again
    LATE = 256  # scans show the surface of an earlier layer
    TURNED = 512  # scans are mirrored or turned against the patterns
    VOLUME = 1024  # droplets bring more or less than is believed of any ink


NO_REASON = UntrustedReason(0)
TRANSFORMS = (
    "", "", "mirrored in x", "mirrored in y", "turned by 180 degrees", "transposed", "turned by 90 degrees",
    "turned by 270 degrees", "transposed and turned by 180 degrees",
)  # fmt: skip
"""What brings a scan to the printer, by the number that an estimate reports."""


@dataclass(frozen=True)
class EstimateFigures:
    """What is reported of an estimate (controller/core/observer/surface_estimate.h).

    volume: of the inks as a share of the nominal ones, mean over the inks; droplet_std: of a droplet's volume, as a
    share of it, 0 before any layer; noise_std: of a reading [m]; ground: of the first scan on ground called flat:
    height of its middle, its rise over the grid along x and y [m]; surprise: what scans differ from predictions by, in
    standard deviations; blind_share: of the part that the last scan did not measure; excess: the most that a cell is
    higher by its droplets than by its scan [m], at number excess_cell; rise: the most that a cell stands above its
    target and what its droplets explain [m], at rise_cell; shift_x, shift_y: of the last scan in the middle of the
    grid [cells]: its reading of a cell is of the plant so far beyond it; shift_std: of their errors, the larger one;
    spot_radius: standard deviation of the Gaussian spot [cells], 0 while it cannot be distinguished from a point;
    spot_std: of its error; rotation [rad] and magnification [1] of the scans; stop: the reason that stopped the print,
    in layer stop_layer; transform: number in TRANSFORMS; stop_figure: how many times better a scan fits than as read,
    or a volume; is_displaced: scans are read as displaced ones; is_foreign: droplets spill onto their neighbours in
    another way than the model's; scans: so far.
    """

    volume: float = 1.0
    droplet_std: float = 0.0
    noise_std: float = 0.0
    ground: tuple[float, float, float] = (0.0, 0.0, 0.0)
    surprise: float = 1.0
    blind_share: float = 0.0
    excess: float = 0.0
    rise: float = 0.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    shift_std: float = 0.0
    spot_radius: float = 0.0
    spot_std: float = 0.0
    rotation: float = 0.0
    magnification: float = 0.0
    stop_figure: float = 0.0
    reasons: UntrustedReason = NO_REASON
    stop: UntrustedReason = NO_REASON
    stop_layer: int = 0
    transform: int = 0
    unseen_cells: int = 0
    dead_cells: int = 0
    capped_cells: int = 0
    excess_cell: int = 0
    rise_cell: int = 0
    is_displaced: bool = False
    is_foreign: bool = False
    scans: int = 0

    @classmethod
    def of_struct(cls, struct: FiguresStruct) -> EstimateFigures:
        """The figures from C."""
        found = {field.name: getattr(struct, field.name) for field in fields(cls)}
        flags = {name: UntrustedReason(found[name]) for name in ("reasons", "stop")}
        marks = {name: bool(found[name]) for name in ("is_displaced", "is_foreign")}
        return cls(**{**found, **flags, **marks, "ground": tuple(found["ground"])})


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate after a scan.

    height: (nx, ny) [m]; height_variance: (nx, ny) of its error [m^2]; inks: what their droplets really add; dead,
    capped: (nx, ny) cells whose droplets do not come, and that are given no more ink; untrusted: (nx, ny) cells of
    the part that have lived on prediction for too many layers, and are unsure; figures: what is reported; state: maps
    by name, and `known`, which only C reads.
    """

    height: FloatMap
    height_variance: FloatMap
    inks: tuple[Ink, ...]
    dead: BoolMap
    capped: BoolMap
    untrusted: BoolMap
    figures: EstimateFigures
    state: Mapping[str, NDArray[Any]]

    @classmethod
    def exact(cls, height: FloatMap, inks: tuple[Ink, ...]) -> Estimate:
        """A surface (nx, ny) [m] and inks that are known for sure."""
        none = np.zeros(height.shape, np.bool_)
        return cls(height, np.zeros(height.shape), inks, none, none, none, EstimateFigures(), {})

    @property
    def ink_scale(self) -> float:
        """Volume of the inks as a share of the nominal one, mean over the inks."""
        return self.figures.volume

    @property
    def predicted_variance(self) -> FloatMap:
        """(nx, ny) of the height after one more layer [m^2], full and on a flat surface; then the next scan comes."""
        squares = max(ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3) for ink in self.inks)
        return self.height_variance + DROPLET_STD * DROPLET_STD * squares

    @cached_property
    def struct(self) -> EstimateStruct:
        """The state for C, which reads it where it is."""
        return EstimateStruct(*(pointer(self.state[name]) for name in _STATE))


_STATE: Mapping[str, str] = {
    "height": "f8", "height_variance": "f8", "ledger": "f8", "last": "f8", "surprise": "f8", "dead_evidence": "f8",
    "unseen": "i4", "last_valid": "u1", "surprised": "u1", "capped": "?", "known": "u1",
}  # fmt: skip
"""Type of each array of a state, in the order of `SurfaceEstimate`; all but the last are maps."""


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
        adapt_ink: Annotated[InkModel, Option()] = "scale",
        sensor_noise_std: Annotated[float | None, SENSOR_NOISE] = None,
        sensor_resolution: Annotated[float, Option("um", form=Length)] = 0.0,
        untrusted_layers: Annotated[int, Option()] = 5,
        register_scans: Annotated[bool, REGISTERED] = True,
        flat_ground: Annotated[bool | None, FLAT_GROUND] = None,
        volume_least: Annotated[float, VOLUME_LEAST] = 0.5,
        volume_most: Annotated[float, VOLUME_MOST] = 1.25,
        drop_levels: int = 1,
        take_as_read: bool = False,
        threads: int = 1,
    ) -> None:
        errors = []
        if adapt_ink not in INK_MODELS:
            errors.append(f'adapt_ink is {adapt_ink!r}; needs "scale", "full" or "off"')
        if sensor_noise_std is not None and not 0.0 <= sensor_noise_std < np.inf:
            errors.append(f"sensor_noise_std is {sensor_noise_std}; needs a standard deviation of at least 0 m")
        if not 0.0 <= sensor_resolution < np.inf:
            errors.append(f"sensor_resolution is {sensor_resolution}; needs a step of at least 0 m")
        if threads < 1:
            errors.append(f"threads is {threads}; needs at least 1")
        if untrusted_layers < 0:
            errors.append(f"untrusted_layers is {untrusted_layers}; needs a number of layers >= 0")
        if not 0.01 <= volume_least <= 1.0 <= volume_most <= 100.0:
            errors.append(
                f"volume_least is {volume_least} and volume_most {volume_most}; needs shares of the nominal volume of "
                "0.01 to 1 and of 1 to 100"
            )
        if errors:
            raise ValueError("; ".join(errors))
        self._job, self._model, self._untrusted_layers = job, LayerModel.of(job), untrusted_layers
        self._threads, self._layer = threads, drop_levels * max(ink.layer_height for ink in job.inks)
        self._part, self._target = np.ascontiguousarray(job.mask), np.ascontiguousarray(job.target_height)
        steps, layer_height = sensor_resolution * sensor_resolution / 12.0, nominal_layer_height(job)
        self._options = EstimatorOptionsStruct(
            job.nx,
            job.ny,
            pointer(self._part),
            pointer(self._target),
            InkPriorStruct(len(job.inks), ink_pair(job.inks), INK_MODELS[adapt_ink]),
            drop_levels,
            job.height_start is None if flat_ground is None else flat_ground,
            take_as_read,
            register_scans,
            untrusted_layers,
            -1.0 if sensor_noise_std is None else sensor_noise_std * sensor_noise_std + steps,
            steps,
            layer_height * layer_height,
            volume_least,
            volume_most,
        )

    def first(self, measured: FloatMap, valid: BoolMap, layer: int = 0) -> Estimate:
        """The surface on which the print begins, that of layer number `layer`.

        A cell that was not measured counts as bare substrate, height 0, give or take a layer.
        """
        after, (scan, seen) = self._room(), self._scan(measured, valid)
        struct = EstimateStruct(*map(pointer, after.values()))
        answered(library().inkloop_estimate_first(self._options, layer, pointer(scan), pointer(seen), struct))
        return self._estimate(after)

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
        shape, (scan, seen) = self._part.shape, self._scan(measured, valid)
        jetted = checked("pattern", pattern, "i4", shape)
        volumes = None if factor is None else checked("factor", factor, "f8", shape)
        known = self._known(before)
        after = self._room()
        struct = EstimateStruct(*map(pointer, after.values()))
        jetted_layer = layer_struct(jetted, self._model.colours(layer), volumes, self._threads)
        given = (self._options, known, jetted_layer, layer, is_unknown, pointer(scan), pointer(seen), struct)
        answered(library().inkloop_estimate_next(*given))
        return self._estimate(after)

    def trust_again(self, estimate: Estimate) -> Estimate:
        """The same after a person has looked: the print goes on, and the next scan is taken as it is."""
        if not estimate.state:
            return estimate
        after = {name: array.copy() for name, array in estimate.state.items()}
        library().inkloop_trust_again(EstimateStruct(*map(pointer, after.values())), self._part.size)
        return self._estimate(after)

    def restored(self, state: Mapping[str, NDArray[Any]]) -> Estimate:
        """An estimate from its state. Raises ValueError for arrays that are none."""
        shape, size = self._part.shape, library().inkloop_knowledge_size()
        arrays = {
            name: laid_out(name, state[name], dtype, (size,) if name == "known" else shape)
            for name, dtype in _STATE.items()
        }
        return self._estimate(arrays)

    def _known(self, estimate: Estimate) -> EstimateStruct:
        if estimate.height.shape != self._part.shape:
            raise ValueError(f"height has shape {estimate.height.shape}; needs {self._part.shape}")
        if not estimate.state:
            raise ValueError("the estimate before has no state; needs one that `first` or `next` has returned")
        return estimate.struct

    def _scan(self, measured: FloatMap, valid: BoolMap) -> tuple[FloatMap, BoolMap]:
        """A scan for C; what was not seen is never looked at, and may be no number."""
        seen = checked("valid", valid, "?", self._part.shape)
        heights = measured if seen.all() else np.where(seen, measured, 0.0)
        return checked("measured", heights, "f8", self._part.shape), seen

    def _room(self) -> dict[str, NDArray[Any]]:
        """Memory for C to write a state."""
        size = library().inkloop_knowledge_size()
        return {name: np.empty(size if name == "known" else self._part.shape, dtype) for name, dtype in _STATE.items()}

    def _estimate(self, state: Mapping[str, NDArray[Any]]) -> Estimate:
        struct, found = EstimateStruct(*(pointer(array) for array in state.values())), FiguresStruct()
        library().inkloop_estimate_figures(self._options, struct, found)
        is_unsure = state["height_variance"] > (UNSURE * self._layer) ** 2
        return Estimate(
            height=state["height"],
            height_variance=state["height_variance"],
            inks=tuple(Ink(ink.h1, ink.h2, ink.h3) for ink in found.ink[: len(self._job.inks)]),
            dead=np.asarray(state["dead_evidence"] >= DEAD_EVIDENCE, np.bool_),
            capped=state["capped"],
            untrusted=np.asarray(self._job.mask & (state["unseen"] > self._untrusted_layers) & is_unsure, np.bool_),
            figures=EstimateFigures.of_struct(found),
            state=state,
        )


def is_probe(layer: int) -> bool:
    """Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned."""
    return layer % PROBE_LAYERS == 0

"""Estimate the surface and the real volume of droplets from scans, as the planner's initial state."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Annotated, Any

import numpy as np

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller.core.bindings import answered, checked, ink_pair, laid_out, layer_struct, pointer
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import EstimateStruct, EstimatorOptionsStruct, InkPriorStruct
from inkloop_controller.estimation.ink_identification import INK_MODELS, InkKnowledge, InkModel, ink_table
from inkloop_controller.estimation.loop_trust import LoopTrust
from inkloop_controller.estimation.scan_registration import DISPLACEMENTS, Registration
from inkloop_controller.model.layer_model import LayerModel
from inkloop_controller.model.regions import nominal_layer_height
from inkloop_controller.problem.horizon_problem import IntMap
from inkloop_controller.problem.options import Length, Option

SENSOR_NOISE = Option(
    unit="um",
    meaning="standard deviation of a reading; 0: readings are exact",
    absent="estimated from the cells that are not printed",
    form=Length | None,
)
REGISTERED = Option(
    meaning="find a shift of the scans against the printer and a wide spot of the sensor, and correct scans for them "
    "once they are beyond doubt"
)
FLAT_GROUND = Option(
    meaning="layer 0 is flat, of height 0: a first scan that shows an offset or a tilt makes the status untrusted",
    absent="where the scenario has no `[substrate]`",
    form=bool | None,
)
DROPLET_STD = 0.1  # of a droplet's volume about its mean [1], as in controller/core/estimator/height_estimator.h


@dataclass(frozen=True, eq=False)
class Estimate:
    """The estimate after a scan.

    height: (nx, ny) [m]; height_variance: (nx, ny) of its error [m^2]; inks: what their droplets really add; ink_scale:
    their volume as a share of the nominal one, mean over the inks [1]; unseen: (nx, ny) layers that each cell has lived
    on prediction alone; untrusted: (nx, ny) where these are too many; dead_evidence: (nx, ny), see `dead_cells`;
    response: (3, nx, ny) how the heights err with the displacement of the scans [m per unit of it], to which
    height_variance adds what it does not explain; reckoned: (nx, ny) height by the droplets alone, without a reading of
    the cell [m]; capped: (nx, ny) cells that are given no more ink; scans: so far; noise_variance: of a reading [m^2];
    learnt: what the inks are concluded from; registration: the displacement of the scans; trust: what makes the print
    doubtful.
    """

    height: FloatMap
    height_variance: FloatMap
    inks: tuple[Ink, ...]
    ink_scale: float
    unseen: IntMap
    untrusted: BoolMap
    dead_evidence: FloatMap
    response: FloatMap
    reckoned: FloatMap
    capped: BoolMap
    scans: int
    noise_variance: float
    learnt: InkKnowledge
    registration: Registration
    trust: LoopTrust

    @classmethod
    def exact(cls, height: FloatMap, inks: tuple[Ink, ...]) -> Estimate:
        """A surface (nx, ny) [m] and inks that are known for sure."""
        never = np.zeros(height.shape, np.int32)
        zero, response = np.zeros(height.shape), np.zeros((DISPLACEMENTS, *height.shape))
        nothing = (InkKnowledge.none(len(inks), len(inks)), Registration.none(), LoopTrust.full())
        return cls(height, zero, inks, 1.0, never, never > 0, zero, response, height, never > 0, 0, 0.0, *nothing)

    @cached_property
    def struct(self) -> EstimateStruct:
        """The same for C, which reads the maps where they are."""
        shape = self.height.shape
        maps = (
            laid_out("height", self.height, "f8", shape),
            laid_out("height_variance", self.height_variance, "f8", shape),
            laid_out("unseen", self.unseen, "i4", shape),
            laid_out("dead_evidence", self.dead_evidence, "f8", shape),
            laid_out("response", self.response, "f8", (DISPLACEMENTS, *shape)),
            laid_out("reckoned", self.reckoned, "f8", shape),
            laid_out("capped", self.capped, "?", shape),
        )
        learnt = (self.learnt.struct(), self.registration.struct(), self.trust.struct())
        return EstimateStruct(*map(pointer, maps), ink_pair(self.inks), *learnt, self.noise_variance, self.scans)

    @property
    def dead(self) -> BoolMap:
        """(nx, ny) cells whose droplets do not come."""
        return np.asarray(self.dead_evidence >= DEAD_EVIDENCE, np.bool_)

    @property
    def predicted_variance(self) -> FloatMap:
        """(nx, ny) of the height after one more layer [m^2], full and on a flat surface; then the next scan comes."""
        squares = max(ink.h1 * ink.h1 + 4.0 * (ink.h2 * ink.h2) + 4.0 * (ink.h3 * ink.h3) for ink in self.inks)
        variance = self.height_variance + DROPLET_STD * DROPLET_STD * squares
        if self.registration.is_applied:
            of_displacement, covariance = np.zeros(variance.shape), self.registration.covariance
            for k, each in enumerate(self.response):
                for m, other in enumerate(self.response):  # in the order in which C adds them
                    of_displacement += each * covariance[k, m] * other
            variance += of_displacement
        return variance

    def arrays(self) -> dict[str, Any]:
        """All of it by name, for an archive of arrays."""
        plain = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "learnt"}
        return {
            **plain,
            **self.learnt.arrays(),
            "inks": ink_table(self.inks),
            "registration": self.registration.sums(),
            "trust": self.trust.sums(),
        }

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Any]) -> Estimate:
        """Restore the result of `arrays`, bit by bit."""
        made: dict[str, Any] = {
            "inks": tuple(Ink(*(float(value) for value in row)) for row in arrays["inks"]),
            "learnt": InkKnowledge.of_arrays(arrays),
            "registration": Registration.of_sums(arrays["registration"]),
            "trust": LoopTrust.of_sums(arrays["trust"]),
        }
        names = [field.name for field in fields(cls)]
        return cls(**{name: made[name] if name in made else arrays[name] for name in names})


class HeightEstimator:
    """A Kalman filter per cell on the layer model, around sensor drift, the ink, and cells that were not seen.

    The method is described in controller/core/estimator/height_estimator.h. A reading has the variance
    sensor_noise_std^2 + sensor_resolution^2 / 12 [m^2]; without sensor_noise_std the noise is what the unprinted cells
    show. untrusted_layers: as many a cell may live on prediction alone; register_scans: scans are corrected for a shift
    against the printer and for a wide spot; flat_ground: layer 0 is flat, of height 0 (None: where the job has no other
    start surface); drop_levels: largest number of drops of a droplet; take_as_read: none of these is looked for, nor
    drift, noise and doubts; threads: the estimate is the same for any number. Raises ValueError for invalid options.
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
        drop_levels: int = 1,
        take_as_read: bool = False,
        threads: int = 1,
    ) -> None:
        errors = []
        if adapt_ink not in ("scale", "full", "off"):
            errors.append(f'adapt_ink is {adapt_ink!r}; needs "scale", "full" or "off"')
        if sensor_noise_std is not None and not 0.0 <= sensor_noise_std < np.inf:
            errors.append(f"sensor_noise_std is {sensor_noise_std}; needs a standard deviation of at least 0 m")
        if not 0.0 <= sensor_resolution < np.inf:
            errors.append(f"sensor_resolution is {sensor_resolution}; needs a step of at least 0 m")
        if threads < 1:
            errors.append(f"threads is {threads}; needs at least 1")
        if untrusted_layers < 0:
            errors.append(f"untrusted_layers is {untrusted_layers}; needs a number of layers >= 0")
        if errors:
            raise ValueError("; ".join(errors))
        self._job, self._model, self._untrusted_layers = job, LayerModel.of(job), untrusted_layers
        self._threads = threads
        self._part, self._target = np.ascontiguousarray(job.mask), np.ascontiguousarray(job.target_height)
        self._shares = len(job.inks) * (3 if adapt_ink == "full" else 1)
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
        )

    def first(self, measured: FloatMap, valid: BoolMap, layer: int = 0) -> Estimate:
        """The surface on which the print begins, that of layer number `layer`.

        A cell that was not measured counts as bare substrate, height 0, give or take a layer.
        """
        after = self._maps(np.empty((DISPLACEMENTS, *self._part.shape)))
        scan, seen = self._scan(measured, valid)
        struct = EstimateStruct(*map(pointer, after))
        answered(library().inkloop_estimate_first(self._options, layer, pointer(scan), pointer(seen), struct))
        return self._estimate(after, struct)

    def next(
        self,
        before: Estimate,
        pattern: IntMap,
        layer: int,
        measured: FloatMap,
        valid: BoolMap,
        factor: FloatMap | None = None,
        *,
        in_place: bool = False,
    ) -> Estimate:
        """Layer number `layer` (from 1) was printed as `pattern` and scanned: measured (nx, ny) [m], where valid.

        factor: (nx, ny) volume of each droplet [1]; in_place: the new response overwrites the one before. If memory
        runs out, the estimate before stays as it was.
        """
        called = library().inkloop_estimate_next
        return self._after(called, before, pattern, layer, measured, valid, factor, in_place)

    def after_unknown(
        self,
        before: Estimate,
        pattern: IntMap,
        layer: int,
        measured: FloatMap,
        valid: BoolMap,
        factor: FloatMap | None = None,
        *,
        in_place: bool = False,
    ) -> Estimate:
        """The estimate after a layer aborted at an unknown place: the scan counts, nothing is learnt."""
        called = library().inkloop_estimate_unknown
        return self._after(called, before, pattern, layer, measured, valid, factor, in_place)

    def _after(
        self,
        estimate: Callable[..., int],
        before: Estimate,
        pattern: IntMap,
        layer: int,
        measured: FloatMap,
        valid: BoolMap,
        factor: FloatMap | None,
        in_place: bool,
    ) -> Estimate:
        shape = self._part.shape
        scan, seen = self._scan(measured, valid)
        jetted = checked("pattern", pattern, "i4", shape)
        volumes = None if factor is None else checked("factor", factor, "f8", shape)
        laid_out("height", before.height, "f8", shape)  # of this grid; the rest is like it
        known, response = before.struct, (DISPLACEMENTS, *shape)
        after = self._maps(laid_out("response", before.response, "f8", response) if in_place else np.empty(response))
        struct = EstimateStruct(*map(pointer, after))
        code = estimate(
            self._options,
            known,
            layer_struct(jetted, self._model.colours(layer), volumes, self._threads),
            pointer(scan),
            pointer(seen),
            struct,
        )
        answered(code)
        return self._estimate(after, struct)

    def _scan(self, measured: FloatMap, valid: BoolMap) -> tuple[FloatMap, BoolMap]:
        """A scan for C; what was not seen is never looked at, and may be no number."""
        seen = checked("valid", valid, "?", self._part.shape)
        heights = measured if seen.all() else np.where(seen, measured, 0.0)
        return checked("measured", heights, "f8", self._part.shape), seen

    def _maps(self, response: FloatMap) -> tuple[FloatMap, ...]:
        """Maps for C to write, in the order of an EstimateStruct; with this response."""
        shape = self._part.shape
        height, variance, dead_evidence, reckoned = (np.empty(shape) for _ in range(4))
        return height, variance, np.empty(shape, np.int32), dead_evidence, response, reckoned, np.empty(shape, "?")

    def _estimate(self, maps: tuple[Any, ...], found: EstimateStruct) -> Estimate:
        height, variance, unseen, dead_evidence, response, reckoned, capped = maps
        inks = tuple(Ink(ink.h1, ink.h2, ink.h3) for ink in found.ink[: len(self._job.inks)])
        estimate = Estimate(
            height=height,
            height_variance=variance,
            inks=inks,
            ink_scale=_volume(inks) / _volume(self._job.inks),
            unseen=unseen,
            untrusted=np.asarray(self._job.mask & (unseen > self._untrusted_layers), np.bool_),
            dead_evidence=dead_evidence,
            response=response,
            reckoned=reckoned,
            capped=capped,
            scans=found.scans,
            noise_variance=found.noise_variance,
            learnt=InkKnowledge.of_struct(found.learnt, self._shares, len(self._job.inks)),
            registration=Registration.of_struct(found.registration),
            trust=LoopTrust.of_struct(found.trust),
        )
        vars(estimate)["struct"] = found  # as C has written it, and will read it after the next scan
        return estimate


def _volume(inks: tuple[Ink, ...]) -> float:
    return sum(ink.layer_height for ink in inks)


DEAD_EVIDENCE = 15.0  # from here on a cell is dead
PROBE_LAYERS = 5  # every so many layers the dead cells are tried again (assumed)


def is_probe(layer: int) -> bool:
    """Whether dead cells are tried again in layer number `layer`: a nozzle may have been cleaned."""
    return layer % PROBE_LAYERS == 0

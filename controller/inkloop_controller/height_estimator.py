"""From scans to what the planner starts from: the surface, and how much ink a droplet really brings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from inkloop.component import BoolMap, FloatMap, Ink, Job
from inkloop_controller.dead_cells import DEAD_EVIDENCE, dead_evidence
from inkloop_controller.droplet_increments import droplet_increments, ink_table
from inkloop_controller.horizon_problem import IntMap
from inkloop_controller.ink_identification import InkEvidence, InkIdentification, InkModel
from inkloop_controller.layer_model import LayerModel
from inkloop_controller.regions import nominal_layer_height
from inkloop_controller.scan_drift import ScanDrift

DROPLET_STD = 0.1  # of a droplet's volume about its mean [1]; 20 % uniform variation has 0.06, 40 % 0.12 (assumed)
ROUNDS, WIDTHS_AGREE = 5, 0.01  # of the ink by the widths of saturation that follow from it, until they agree (assumed)
SURPRISE = (
    5.0  # standard deviations off the prediction from which on the model of a cell is wrong, not the scan (by trial)
)


@dataclass(frozen=True)
class Estimate:
    """What is known after a scan.

    height: (nx, ny) [m]; height_variance: (nx, ny) of its error [m^2]; inks: what their droplets really add; ink_scale:
    their volume as a share of the nominal one, mean over the inks [1]; unseen: (nx, ny) layers that each cell has lived
    on prediction alone; untrusted: (nx, ny) where these are too many; dead_evidence: (nx, ny), see `dead_cells`; scans:
    so far; noise_variance: of a reading [m^2]; evidence: what the inks are concluded from.
    """

    height: FloatMap
    height_variance: FloatMap
    inks: tuple[Ink, ...]
    ink_scale: float
    unseen: IntMap
    untrusted: BoolMap
    dead_evidence: FloatMap
    scans: int
    noise_variance: float
    evidence: InkEvidence

    @classmethod
    def exact(cls, height: FloatMap, inks: tuple[Ink, ...]) -> Estimate:
        """A surface (nx, ny) [m] and inks that are known for sure."""
        never = np.zeros(height.shape, np.int32)
        zero, nothing = np.zeros(height.shape), InkEvidence.none(len(inks))
        return cls(height, zero, inks, 1.0, never, never > 0, zero, 0, 0.0, nothing)

    @property
    def dead(self) -> BoolMap:
        """(nx, ny) cells whose droplets do not come."""
        return np.asarray(self.dead_evidence >= DEAD_EVIDENCE, np.bool_)

    @property
    def predicted_variance(self) -> FloatMap:
        """(nx, ny) of the height after one more layer [m^2], full and on a flat surface; then the next scan comes."""
        squares = max(ink.h1**2 + 4.0 * ink.h2**2 + 4.0 * ink.h3**2 for ink in self.inks)
        return self.height_variance + DROPLET_STD**2 * squares

    def arrays(self) -> dict[str, Any]:
        """All of it by name, for an archive of arrays."""
        return {**vars(self), "inks": ink_table(self.inks), "evidence": self.evidence.sums()}

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, Any]) -> Estimate:
        """What `arrays` gave, bit by bit."""
        inks = tuple(Ink(*(float(value) for value in row)) for row in arrays["inks"])
        return cls(**{**arrays, "inks": inks, "evidence": InkEvidence.of_sums(arrays["evidence"])})


class HeightEstimator:
    """A Kalman filter per cell on the layer model, around sensor drift, the ink, and cells that were not seen.

    A layer adds droplet_std^2 * (sum of the squares of what each droplet adds to the cell) to the variance of a cell's
    prediction, a reading has sensor_noise_std^2 + sensor_resolution^2 / 12. Without sensor_noise_std [m] the noise is
    what the unprinted cells show; a sensor that shows none is taken as it is. Errors of neighbours are taken to be
    independent. A cell that grew in a way that neither explains follows the scan: its droplets are not what they should
    be; where they bring nothing layer after layer it is dead. untrusted_layers: as many a cell may live on prediction
    alone; take_as_read: neither drift nor noise are looked for. Raises ValueError for options that cannot be meant.
    """

    def __init__(
        self,
        job: Job,
        *,
        adapt_ink: InkModel = "scale",
        sensor_noise_std: float | None = None,
        sensor_resolution: float = 0.0,
        untrusted_layers: int = 5,
        take_as_read: bool = False,
    ) -> None:
        faults = []
        if adapt_ink not in ("scale", "full", "off"):
            faults.append(f'adapt_ink is {adapt_ink!r}; needs "scale", "full" or "off"')
        if sensor_noise_std is not None and not 0.0 <= sensor_noise_std < np.inf:
            faults.append(f"sensor_noise_std is {sensor_noise_std}; needs a standard deviation of at least 0 m")
        if not 0.0 <= sensor_resolution < np.inf:
            faults.append(f"sensor_resolution is {sensor_resolution}; needs a step of at least 0 m")
        if untrusted_layers < 0:
            faults.append(f"untrusted_layers is {untrusted_layers}; needs a number of layers >= 0")
        if faults:
            raise ValueError("; ".join(faults))
        self._job, self._model, self._untrusted_layers = job, LayerModel.of(job), untrusted_layers
        self._drift, self._ink = ScanDrift(job.mask), InkIdentification(job, adapt_ink)
        self._steps_variance = sensor_resolution**2 / 12.0
        self._noise_variance = None if sensor_noise_std is None else sensor_noise_std**2 + self._steps_variance
        self._take_as_read, self._learns_widths = take_as_read, adapt_ink == "full"

    def first(self, measured: FloatMap, valid: BoolMap) -> Estimate:
        """The start surface; a cell that was not measured counts as bare substrate, height 0, give or take a layer."""
        noise = self._noise_variance or 0.0
        unseen = (~valid).astype(np.int32)
        return Estimate(
            height=np.where(valid, measured, 0.0),
            height_variance=np.where(valid, noise, nominal_layer_height(self._job) ** 2),
            inks=self._job.inks,
            ink_scale=1.0,
            unseen=unseen,
            untrusted=self._untrusted(unseen),
            dead_evidence=np.zeros(unseen.shape),
            scans=1,
            noise_variance=noise,
            evidence=self._ink.start(),
        )

    def next(
        self,
        before: Estimate,
        pattern: IntMap,
        layer: int,
        measured: FloatMap,
        valid: BoolMap,
        factor: FloatMap | None = None,
    ) -> Estimate:
        """Layer number `layer` (from 1) was printed as `pattern` and scanned: measured (nx, ny) [m], where valid.

        factor: (nx, ny) volume of each droplet [1].
        """
        scan, noise = np.where(valid, measured, 0.0), 0.0
        if not self._take_as_read:
            drift = self._drift.seen(scan, before.height, valid)
            scan, noise = scan - drift.plane, self._noise(before, drift.residual_variance)
        known = before.height_variance
        if before.scans == 1 and self._noise_variance is None:  # only now the first scan shows what it was worth
            known = np.where(before.unseen == 0, noise, known)
        evidence, inks, spread = before.evidence, before.inks, known
        flat = droplet_increments(np.zeros(scan.shape), pattern, inks, (), factor)
        for _ in range(ROUNDS):
            widths = inks
            increments = droplet_increments(before.height, pattern, widths, self._model.colours(layer), factor)
            spread = known + DROPLET_STD**2 * increments.squares
            growth = scan - before.height
            evidence = self._ink.after(before.evidence, pattern, increments, flat, growth, spread + noise, valid)
            inks = self._ink.inks(evidence)
            if np.allclose(ink_table(inks), ink_table(widths), rtol=WIDTHS_AGREE, atol=0.0):
                break
        in_proportion = widths
        if self._learns_widths:  # what droplets spill is surer by the nominal proportions
            in_proportion = _of_volumes(self._job.inks, inks)
            increments = droplet_increments(before.height, pattern, in_proportion, self._model.colours(layer), factor)
        predicted = replace(self._model, inks=inks).layer(before.height, pattern, layer, factor)
        unseen = np.where(valid, 0, before.unseen + 1).astype(np.int32)
        height, variance = _corrected(predicted, spread, scan, noise, valid)
        return Estimate(
            height=height,
            height_variance=variance,
            inks=inks,
            ink_scale=_volume(inks) / _volume(self._job.inks),
            unseen=unseen,
            untrusted=self._untrusted(unseen),
            dead_evidence=dead_evidence(
                before.dead_evidence,
                np.where(valid, increments.own, 0.0),
                growth - increments.added(in_proportion) + increments.own,
                spread + noise,
                int(self._job.mask.sum()),
            ),
            scans=before.scans + 1,
            noise_variance=noise,
            evidence=evidence,
        )

    def _noise(self, before: Estimate, residual_variance: float | None) -> float:
        """Variance of a reading [m^2]: as given, or the mean over the scans of what the unprinted cells show."""
        if self._noise_variance is not None:
            return self._noise_variance
        if residual_variance is None:
            return max(before.noise_variance, self._steps_variance)
        of_reading = residual_variance / (1.0 + 1.0 / before.scans)  # the known heights have been averaged so often
        weight = 1.0 / before.scans
        return max((1.0 - weight) * before.noise_variance + weight * of_reading, self._steps_variance)

    def _untrusted(self, unseen: IntMap) -> BoolMap:
        return np.asarray(self._job.mask & (unseen > self._untrusted_layers), np.bool_)


def _corrected(
    predicted: FloatMap, spread: FloatMap, scan: FloatMap, noise: float, valid: BoolMap
) -> tuple[FloatMap, FloatMap]:
    """Kalman correction of each cell: (height [m], variance [m^2])."""
    if noise == 0.0:
        return np.where(valid, scan, predicted), np.where(valid, 0.0, spread)
    surprise = (scan - predicted) ** 2
    spread = np.where(valid & (surprise > SURPRISE**2 * (spread + noise)), surprise, spread)
    gain = np.where(valid, spread / (spread + noise), 0.0)
    return predicted + gain * (scan - predicted), (1.0 - gain) * spread


def _of_volumes(nominal: tuple[Ink, ...], learnt: tuple[Ink, ...]) -> tuple[Ink, ...]:
    """The nominal inks in the volumes of the learnt ones."""
    shares = [one.layer_height / other.layer_height for one, other in zip(learnt, nominal, strict=True)]
    return tuple(Ink(s * ink.h1, s * ink.h2, s * ink.h3) for s, ink in zip(shares, nominal, strict=True))


def _volume(inks: tuple[Ink, ...]) -> float:
    return sum(ink.layer_height for ink in inks)

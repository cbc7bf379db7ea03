"""The height estimator without registration, stated in NumPy to check controller/core/estimator.

Kalman filter per cell, drift plane from the unprinted cells, shares of the inks by instrumental variables. The layer
map is lu_numpy's; what single droplets add is found by printing each alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inkloop.component import Job
from support.numpy import lu_numpy

DROPLET_STD, SURPRISE = 0.1, 5.0
LEVERAGE_MAX, LEAST_CELLS = 0.25, 8
PRIOR_STD, FORGETTING = 0.5, 0.8


@dataclass(frozen=True)
class Evidence:
    """Sums over the layers of n learnt shares: instrument times what a share adds (n, n), times growth beyond the
    nominal (n,), and the covariance of the latter (n, n).
    """

    response: Any
    surplus: Any
    covariance: Any

    @classmethod
    def none(cls, shares: int) -> Evidence:
        return cls(np.zeros((shares, shares)), np.zeros(shares), np.zeros((shares, shares)))


@dataclass(frozen=True)
class Learnt:
    """What is known of the inks by one model: their heights (inks, 3) [m], the evidence, and how wrong it predicted."""

    inks: Any
    evidence: Evidence
    error: float = 0.0


@dataclass(frozen=True)
class State:
    """Maps (nx, ny) [m], [m^2], layers; heights of the inks for plans (inks, 3) [m]; what each model has learnt.

    spread: (nx, ny) variance of the prediction of the last layer [m^2].
    """

    height: Any
    variance: Any
    unseen: Any
    inks: Any
    learnt: dict[str, Learnt]
    noise: float
    scans: int
    spread: Any = None


@dataclass(frozen=True)
class Scan:
    """A layer that was jetted on the known `height` and scanned: maps [m], and the variance of a reading [m^2]."""

    height: Any
    known: Any
    pattern: Any
    scan: Any
    valid: Any
    noise: float
    spread: Any = field(default=None)


def near(marked: Any) -> Any:
    """Cells that are marked or touch a marked one."""
    framed = np.pad(marked, 1)
    return np.lib.stride_tricks.sliding_window_view(framed, (3, 3)).any(axis=(2, 3))


def drift(scan: Any, known: Any, part: Any, valid: Any) -> tuple[Any, float | None]:
    """(plane over the grid [m], variance of the readings about it [m^2] or None) of the cells out of reach of the part.

    Least absolute values by reweighting, then least squares of what lies within three robust standard deviations; a
    plane, an offset or nothing, as far as the cells determine it over the part.
    """
    cells = valid & ~near(part)
    i, j = np.indices(part.shape) / max(part.shape) - 0.5
    terms = np.stack([np.ones(part.shape), i, j], axis=-1)
    for count in (3, 1):
        A, rise = terms[cells][:, :count], (scan - known)[cells]
        if len(A) < 3 or np.linalg.matrix_rank(A) < count:
            continue
        leverage = np.einsum("ki,ij,kj->k", terms[part][:, :count], np.linalg.inv(A.T @ A), terms[part][:, :count])
        if leverage.max() > LEVERAGE_MAX:
            continue
        weight = np.ones(len(A))
        for _ in range(8):
            root = np.sqrt(weight)[:, None]
            x = np.linalg.lstsq(root * A, root[:, 0] * rise, rcond=None)[0]
            distance = np.abs(rise - A @ x)
            least = max(0.1 * float(np.median(distance)), 1e-12)
            weight = least / np.maximum(distance, least)
        kept = distance <= max(3.0 * 1.4826 * float(np.median(distance)), 1e-12)
        x = np.linalg.lstsq(A[kept], rise[kept], rcond=None)[0]
        enough = kept.sum() >= LEAST_CELLS
        variance = float(np.sum((rise - A @ x)[kept] ** 2) / (kept.sum() - count)) if enough else None
        return terms[..., :count] @ x, variance
    return np.zeros(part.shape), None


class Estimator:
    """`noise`: of a reading [m^2], None where it is learnt; `model`: "scale", "full" or "off", learnt of each ink."""

    def __init__(self, job: Job, noise: float | None, model: str = "scale") -> None:
        self.part, self.passes, self.noise, self.model = job.mask, job.passes, noise, model
        self.nominal = np.array([(ink.h1, ink.h2, ink.h3) for ink in job.inks])
        self.full = self.layer_height(self.nominal)
        self.unknown = self.layer_height(self.nominal if job.region is not None else self.nominal[:1])

    @staticmethod
    def layer_height(inks: Any) -> float:
        """Mean over the inks of what a full flat layer rises by [m]."""
        return float(np.mean(inks @ [1.0, 4.0, 4.0]))

    def directions(self, model: str) -> Any:
        """(shares, inks, 3): what each share scales [m]: all heights of an ink, or one height alone."""
        count = len(self.nominal)
        if model == "scale":
            return np.einsum("sk,ko->sko", np.eye(count), self.nominal)
        return (np.eye(3 * count) * self.nominal.ravel()).reshape(3 * count, count, 3)

    def passed(self, height: Any, pattern: Any, inks: Any) -> Any:
        """(surface before, droplets, surface after) of each pass of a layer."""
        i, j = np.indices(height.shape)
        for colour in range(4) if self.passes == 4 else [None]:
            now = pattern if colour is None else np.where(2 * (i % 2) + j % 2 == colour, pattern, 0)
            after = lu_numpy.one_pass(height, now, both(inks))[0]
            yield height, now, after
            height = after

    def printed(self, height: Any, pattern: Any, inks: Any) -> Any:
        """The surface after a layer of these inks."""
        return lu_numpy.layer(height, pattern, both(inks), passes=self.passes)[0]

    def squares(self, height: Any, pattern: Any, inks: Any) -> Any:
        """Sum over the droplets of the squares of what each adds to a cell [m^2]."""
        found = np.zeros(height.shape)
        for before, now, _ in self.passed(height, pattern, inks):
            for cell in zip(*np.nonzero(now), strict=True):
                single = np.zeros_like(pattern)
                single[cell] = now[cell]
                found += (lu_numpy.one_pass(before, single, both(inks))[0] - before) ** 2
        return found

    def rates(self, height: Any, pattern: Any, inks: Any) -> Any:
        """(inks, 3, nx, ny): what a metre of each height adds to a cell, over slopes as steep as for these inks [1]."""
        found = np.zeros((len(inks), 3, *np.add(height.shape, 2)))
        own = np.s_[1:-1, 1:-1]
        for before, now, _ in self.passed(height, pattern, inks):
            beyond = np.pad(before, 1, constant_values=-np.inf)
            for number, ink in enumerate(inks):
                jetted = now == number + 1
                found[number, 0][own] += jetted
                for di, dj in np.argwhere(np.ones((3, 3))) - 1:
                    order = abs(di) + abs(dj)
                    there = np.s_[1 + di : 1 + di + height.shape[0], 1 + dj : 1 + dj + height.shape[1]]
                    if order == 0:
                        continue
                    given = jetted * np.clip(1.0 + (before - beyond[there]) / (ink[0] + ink[order]), 0.0, 1.0)
                    found[number, order][there] += given
                    found[number, order][own] += jetted - given
        return found[..., 1:-1, 1:-1]

    def first(self, scan: Any, valid: Any) -> State:
        noise = self.noise or 0.0
        height, variance = np.where(valid, scan, 0.0), np.where(valid, noise, self.unknown**2)
        learnt = {
            model: Learnt(self.nominal, Evidence.none(len(self.directions(model)))) for model in ("scale", "full")
        }
        return State(height, variance, (~valid).astype(int), self.nominal, learnt, noise, 1)

    def next(self, before: State, pattern: Any, scan: Any, valid: Any) -> State:
        scan = np.where(valid, scan, 0.0)
        plane, shown = drift(scan, before.height, self.part, valid)
        scan, noise = scan - plane, self._noise(before, shown)
        learns = self.noise is None and before.scans == 1
        known = np.where(learns & (before.unseen == 0), noise, before.variance)
        inks, learnt, spread = self._learn(before, Scan(before.height, known, pattern, scan, valid, noise))
        predicted = self.printed(before.height, pattern, inks)
        surprise = (scan - predicted) ** 2
        spread_of_seen = np.where(surprise > SURPRISE**2 * (spread + noise), surprise, spread)
        gain = np.where(valid, spread_of_seen / (spread_of_seen + noise) if noise > 0.0 else 1.0, 0.0)
        variance = np.where(valid, (1.0 - gain) * spread_of_seen, spread)
        unseen = np.where(valid, 0, before.unseen + 1)
        height = predicted + gain * (scan - predicted)
        return State(height, variance, unseen, inks, learnt, noise, before.scans + 1, spread)

    def _noise(self, before: State, shown: float | None) -> float:
        """Of a reading: the mean over the scans; the known heights, a mean of n scans, add 1 / n of it."""
        if self.noise is not None:
            return self.noise
        if shown is None:
            return before.noise
        n = before.scans
        return (1.0 - 1.0 / n) * before.noise + shown / (1.0 + 1.0 / n) / n

    def _learn(self, before: State, scan: Scan) -> tuple[Any, dict[str, Learnt], Any]:
        """(inks, what each model has learnt, variance of the prediction [m^2]) after a scan.

        While three heights are learnt, so is the volume; plans use the heights where they spare a fifth of
        what the volume predicts wrong, beyond the scatter of the scans.
        """
        if self.model == "off":
            return self.nominal, before.learnt, self._spread(scan, self.nominal)
        if self.model == "scale":
            learnt, spread = self._turns("scale", before.learnt["scale"], scan)
            return learnt.inks, before.learnt | {"scale": learnt}, spread
        found = {model: self._turns(model, before.learnt[model], scan) for model in ("scale", "full")}
        errors = {model: before.learnt[model].error for model in found}
        if np.any(found["scale"][0].evidence.surplus != before.learnt["scale"].evidence.surplus):
            for model in errors:
                off = scan.scan - self.printed(scan.height, scan.pattern, before.learnt[model].inks)
                errors[model] = FORGETTING * errors[model] + float(
                    np.mean((off**2 - scan.known - scan.noise)[self.part & scan.valid])
                )
        gain = errors["scale"] - errors["full"]
        used = "full" if gain > 0.2 * abs(errors["scale"]) else "scale"
        learnt_of = {model: Learnt(each.inks, each.evidence, errors[model]) for model, (each, _) in found.items()}
        return learnt_of[used].inks, learnt_of, found[used][1]

    def _spread(self, scan: Scan, inks: Any) -> Any:
        return scan.known + DROPLET_STD**2 * self.squares(scan.height, scan.pattern, inks)

    def _turns(self, model: str, before: Learnt, scan: Scan) -> tuple[Learnt, Any]:
        """Inks and the slopes over which their droplets run, by turns until they agree."""
        inks, evidence, spread = before.inks, before.evidence, scan.known
        for _ in range(5):
            widths = inks
            spread = self._spread(scan, widths)
            evidence = self._evidence(model, before, scan, widths, spread + scan.noise)
            inks = self._inks(model, evidence)
            if np.all(np.abs(inks - widths) <= 0.01 * widths):
                break
        return Learnt(inks, evidence), spread

    def _evidence(self, model: str, before: Learnt, scan: Scan, widths: Any, variance: Any) -> Evidence:
        """The sums with those of a layer, or as they are where it shows too little."""
        growth, old = scan.scan - scan.height, before.evidence
        rates, flat = self.rates(scan.height, scan.pattern, widths), self._flat(scan.pattern)
        seen = self.part & scan.valid
        hit = seen & (scan.pattern > 0)
        expected = np.einsum("ko,koij->ij", before.inks, rates)
        if hit.sum() < 20 or expected[seen].mean() < 0.1 * self.full:
            return old
        usual = 1.0 if old.response.any() else float(np.median(growth[hit] / expected[hit]))
        far = np.maximum(0.6 * np.abs(usual * expected), 3.0 * np.sqrt(variance))
        used = seen & ~near(hit & (np.abs(growth - usual * expected) > far))
        if not used.any():
            return old
        directions = self.directions(model)
        adds = np.einsum("sko,koij->sij", directions, rates)[:, used]
        z = np.einsum("sko,koij->sij", directions, flat)[:, used]
        if model == "scale":
            z = np.where(z > 0.0, z.mean(), 0.0)
        surplus = growth[used] - np.einsum("ko,koij->ij", self.nominal, rates)[used]
        return Evidence(
            FORGETTING * old.response + z @ adds.T,
            FORGETTING * old.surplus + z @ surplus,
            FORGETTING**2 * old.covariance + (z * variance[used]) @ z.T,
        )

    def _flat(self, pattern: Any) -> Any:
        """(inks, 3, nx, ny): the rates on a flat surface, all droplets in one pass."""
        framed, flat = np.pad(pattern, 1), []
        for number in range(len(self.nominal)):
            windows = np.lib.stride_tricks.sliding_window_view(framed == number + 1, (3, 3))
            stencils = [[[order == abs(i) + abs(j) for j in (-1, 0, 1)] for i in (-1, 0, 1)] for order in range(3)]
            flat.append([np.sum(windows & np.array(stencil), axis=(2, 3)) for stencil in stencils])
        return np.array(flat)

    def _inks(self, model: str, evidence: Evidence) -> Any:
        """Generalised least squares with a normal prior about 1 for every share, within a quarter and four."""
        if not evidence.covariance.any():
            return self.nominal
        weighted = evidence.response.T @ np.linalg.pinv(evidence.covariance, rcond=1e-9, hermitian=True)
        information = weighted @ evidence.response + np.eye(len(weighted)) / PRIOR_STD**2
        shares = np.clip(1.0 + np.linalg.solve(information, weighted @ evidence.surplus), 0.25, 4.0)
        return np.einsum("s,sko->ko", shares, self.directions(model))


def both(inks: Any) -> tuple[Any, Any]:
    """One or two inks as lu_numpy takes them."""
    return tuple(inks[0]), tuple(inks[-1])

"""The observer of controller/core/observer, stated in NumPy with dense matrices, for small grids.

Heights in metres, geometry in cells. S_g is a matrix (readings, cells); an unknown vector is (geometry, datum, shares).
Grids of at most 640 cells: the core looks at even distances of larger grounds and walls. Nothing is singular here.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np
from scipy.ndimage import maximum_filter

from support.numpy import observer_constants as c
from support.numpy.observer_setup import Setup, State, sampling, volumes_alone
from support.numpy.scan_doubts_numpy import is_doubted
from support.numpy.scan_fit_numpy import (
    Fit,
    Look,
    View,
    fit_datum,
    fit_displaced,
    fit_in_register,
    levelled,
    may_be_displaced,
)


def rounding_variance(readings: Any, layer: float) -> float:
    """Of readings that are all multiples of a step: of their rounding [m^2]."""
    levels = np.unique(readings)
    if len(readings) < c.LEAST_READINGS or not c.LEAST_LEVELS <= len(levels) <= len(readings) / 2:
        return 0.0
    step = float(np.diff(levels).min())
    off = np.abs(np.remainder((levels - levels[0]) / step + 0.5, 1.0) - 0.5).max()
    return step**2 / 12.0 if step > c.LEAST_STEP_READ * layer and off <= c.SAME_STEP else 0.0


class Observer:
    """Estimates surface, ink and geometry of the scans of a print, scan by scan; `setup`: grid and options."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup

    def reading_noise(self, s: State, shown: Any, freedom: float, readings: Any) -> tuple[Any, float]:
        """Step 2: (variances of a reading, their degrees of freedom), learnt from those that a scan shows."""
        o, noise, all_freedom = self.setup, s.noise, s.freedom
        if shown is not None:
            kept, share = c.NOISE_KEPT * s.freedom, 1.0 if s.scans > 1 or o.flat else 0.5
            all_freedom = kept + freedom
            noise = (kept * s.noise + freedom * share * shown) / all_freedom
        about = s.noise[0] if o.noise is not None else noise[0]
        return np.append(max(about, o.steps, c.NOISELESS, rounding_variance(readings, o.layer)), noise[1:]), all_freedom

    def take_scan(self, s: State, before: State, look: Look, layer: int) -> None:
        """Steps 4 and 5: the fits, which one is believed, and the maps."""
        o = self.setup
        is_registered, walls, with_spot = o.registered and not look.is_unknown, look.valid, look.predicted
        in_register = fit = displaced = fit_in_register(o, look)
        if is_registered:
            displaced, walls, with_spot = fit_displaced(o, s, look, in_register)
            fit = displaced if s.is_displaced else in_register
        may_be = is_registered and bool(s.misfits) and may_be_displaced(s)
        lasting = c.KEPT * s.mean_misfit + (1.0 - c.KEPT) * fit.misfit
        is_foreign = not may_be and lasting.max() >= (c.USUAL if fit.is_misfit else c.FOREIGN)
        is_robust = not is_foreign and s.lasting <= c.LASTING * s.vanishing + c.FEW_LAST
        extra = np.append(np.maximum(fit.misfit - c.USUAL, 0.0) * (not may_be and not s.is_displaced), 0.0)
        known = np.maximum(
            look.variance + look.of_droplet * look.squares + extra[look.classes] * look.native, c.LEAST_VARIANCE
        )
        left = np.tensordot(fit.datum, o.terms, 1)
        of_datum = np.einsum("aij,ab,bij->ij", o.terms, fit.datum_covariance, o.terms)
        change = look.change(fit.share)
        g = s.g if s.is_displaced else np.zeros(7)  # in register: displaced by nothing
        ink = fit.share if s.is_displaced else s.share
        view = View(o, look, np.ones(o.shape, np.bool_), g[c.SPREAD], ink)
        view.look(np.concatenate([g, np.zeros(6), [] if o.model == "off" else ink]))
        S, J, doubtful, more = view.S, view.J[:, :7], s.covariance, view.own_variance
        if not s.is_displaced:
            J[:, c.SPREAD] = with_spot.ravel()
            likely = may_be / (1.0 + np.exp(-s.odds))
            J, doubtful, more = J * walls.reshape(-1, 1), likely * (doubtful + np.outer(s.g, s.g)), 0.0
        rest = look.scan - left - (S @ (view.averaged + change - look.change(ink)).ravel()).reshape(o.shape)
        spread = (S @ known.ravel()).reshape(o.shape)
        of_geometry = np.einsum("ra,ab,rb->r", J, doubtful, J) + more
        error = look.noise + of_datum + of_geometry.reshape(o.shape)
        weight, jump, vanished, lasted = self.believed(s, before, look, rest, spread + error, is_robust)
        counted = np.maximum(weight, c.LEAST_WEIGHT)
        weak = error / counted + spread * (1.0 / counted - 1.0)
        weight, rest = np.where(look.valid, 1.0 / weak, 0.0), np.where(look.valid, rest, 0.0)
        there = self.back(g)
        at = [np.clip(place, 0.0, count - 1.0) for place, count in zip(there, o.shape, strict=True)]
        near = tuple(np.ceil(place - 0.5).astype(int) for place in at)
        is_seen, nearest, jump = look.valid[near], rest[near], jump[near]
        variance, back = known + (look.noise if s.is_displaced else error), sampling(o.shape, *there)
        off, weight = ((back @ value.ravel()).reshape(o.shape) for value in (weight * rest, weight))
        off = off / np.where(weight * (known + jump) > c.NOT_SEEN * s.is_displaced, weight, np.inf)
        known = known + jump
        s.unseen = np.where(is_seen, 0, before.unseen + 1)
        s.height = look.predicted + change + known * weight / (1.0 + known * weight) * off
        s.variance = known / (1.0 + known * weight)
        if look.is_unknown:
            return
        s.dead = self.dead(before, look, is_seen, nearest, variance)
        s.vanishing = 0.9 * s.vanishing + 0.1 * vanished / max(look.valid.sum(), 1)
        s.lasting = 0.9 * s.lasting + 0.1 * lasted / max(look.valid.sum(), 1)
        is_better = may_be and in_register.is_misfit
        self.learn(s, look, displaced if s.is_displaced or is_better else in_register, fit)
        if not fit.is_misfit and not s.is_volume_believed:
            self.doubt_volume(s, layer)

    def back(self, g: Any) -> tuple[Any, Any]:
        """Place on the scan of each cell's reading."""
        o = self.setup
        linear = np.eye(2) + g[2:6].reshape(2, 2) / o.half
        inner = np.stack([o.i - o.half[0] - g[0], o.j - o.half[1] - g[1]])
        x, y = np.tensordot(np.linalg.inv(linear), inner, 1)
        return x + o.half[0], y + o.half[1]

    def believed(
        self, s: State, before: State, look: Look, rest: Any, variance: Any, is_robust: bool
    ) -> tuple[Any, Any, int, int]:
        """(weights of the readings, variances by which cells have jumped, surprises that vanished, that lasted)."""
        square, earlier = rest**2 / variance, before.surprise
        weight = 1.0 / (1.0 + np.exp(np.minimum((square - c.SURPRISE**2) / 2.0, 60.0)))
        weight = np.where(square > c.SURPRISE**2 / 2.0, weight, 1.0)
        is_big = weight < c.CERTAIN
        is_same = is_big & (earlier * rest > 0.0) & (np.abs(earlier) > c.SAME * np.abs(rest))
        is_back = is_big & (earlier * rest < 0.0) & (np.abs(rest) > c.SAME * np.abs(earlier))
        times = np.where(is_same, before.surprised + 1, is_big)
        is_real = look.valid & is_same & (times >= (3 if before.vanishing > c.SPIKY else 2))
        s.surprise = np.where(look.valid & is_big & ~is_real, rest, 0.0)
        s.surprised = np.where(look.valid & ~is_real, times, 0)
        has_surprised = look.valid & (earlier != 0.0)
        ends = (square < 1.0, is_same) if is_robust else (is_back, ~is_big)
        is_believed = look.valid & is_big & (is_real | (not is_robust))
        is_failed = (look.pattern > 0) & (earlier < 0.0)  # a droplet that did not come
        vanished, lasted = (int(np.sum(has_surprised & each)) for each in (ends[0], ends[1] & ~is_failed))
        weight, jump = np.where(is_believed | (not is_robust), 1.0, weight), np.where(is_believed, rest**2, 0.0)
        return weight, jump, vanished, lasted

    def dead(self, before: State, look: Look, is_seen: Any, rest: Any, variance: Any) -> Any:
        """Evidence that nothing comes, against a weak droplet."""
        o = self.setup
        grown = rest + np.where(before.dead < c.DEAD, look.own, 0.0)
        weak, least = c.WEAK * look.full_own, np.maximum(np.minimum(variance, look.full_own**2), c.LEAST_VARIANCE)
        evidence = np.where(is_seen & (look.full_own > 0.0), weak * (weak / 2.0 - grown) / least, 0.0)
        if np.sum(evidence > 0.0) > c.WHOLE_HEAD * o.part.sum():
            return before.dead
        return np.clip(before.dead + np.clip(evidence, -c.LAYER_EVIDENCE, c.LAYER_EVIDENCE), 0.0, c.DEAD)

    def learn(self, s: State, look: Look, fit: Fit, believed: Fit) -> None:
        """Variance of droplets, spread of the datum, shares."""
        own = c.DROPLET_STD**2 * fit.squares
        if fit.droplets >= c.LEAST_DROPLETS:
            every = fit.base + s.variation * own
            share = s.variation * own / every
            found, by_median = (
                max(c.LEAST_VARIATION, s.variation + (square - 1.0) * every / own)
                for square in (fit.scatter, fit.misfit[0])
            )
            kept, freedom = c.KEPT * s.evidence, fit.droplets * share**2
            prior = (1.0 - c.KEPT) * c.FIRST_EVIDENCE
            mean = kept * s.variation + prior + freedom * min(found, c.LARGEST_FOUND)
            s.variation = min(mean / (kept + prior + freedom), c.LARGEST_VARIATION)
            s.evidence = min(kept + prior + freedom, c.EVIDENCE_MAX)
            s.layers += 1
            s.mean_misfit = c.KEPT * s.mean_misfit + (1.0 - c.KEPT) * fit.misfit
            if s.layers <= c.EARLY:
                s.early += (by_median - s.early) / s.layers
        if look.datum[3] is not None:
            s.datum = look.datum[0] + believed.datum
            square = np.maximum(s.datum**2, c.LEAST_SPREAD)
            s.datum_spread = c.DATUM_KEPT * s.datum_spread + (1.0 - c.DATUM_KEPT) * square
        s.share, s.share_covariance = believed.share, believed.share_covariance
        if self.setup.model == "full" and s.is_displaced:
            s.share, s.share_covariance = volumes_alone(self.setup.nominal, s.share, s.share_covariance)

    def doubt_volume(self, s: State, layer: int) -> None:
        o, volume = self.setup, self.setup.volume(s.share)
        is_known = o.model == "scale" and np.mean(np.diag(s.share_covariance)) < c.VOLUME_STD**2
        is_wrong = is_known and not o.least <= volume <= o.most
        s.volume_doubt = c.DOUBT_KEPT * s.volume_doubt + is_wrong
        if is_wrong and s.stop[0] == 0 and s.volume_doubt >= c.BELIEVED:
            s.stop = (c.VOLUME, layer, 0, volume)

    def look_at_part(self, s: State) -> None:
        """Cells that are capped, and that stand too high."""
        o, volume = self.setup, self.setup.volume(s.share)
        target, layer_height = o.job.target_height, o.layer * o.drop_levels
        s.blind = s.blind + 1 if np.mean(~s.last_valid[o.part]) > c.BLIND else 0
        rise = np.where(o.part, s.height - np.maximum(target, volume * s.ledger), 0.0) / layer_height
        is_near = maximum_filter(rise > c.RISEN, 3)
        s.full = o.part & (o.least * s.ledger > target + c.RESERVE * layer_height)
        s.capped, s.high = (
            s.full | (o.part & is_near),
            rise > (c.HIGH_FOREIGN if s.mean_misfit[1] > c.SPILL_MAX else c.HIGH),
        )

    def first(self, scan: Any, valid: Any) -> State:
        """Of layer 0."""
        o = self.setup
        noise, shares, scan = max(o.noise or 0.0, o.steps), o.orders * len(o.nominal), np.where(valid, scan, 0.0)
        variance = (c.SHARE_STD.get(o.model, 0.0) ** 2) * np.eye(shares)
        first_variance = float(np.mean(o.nominal @ [1.0, 4.0, 4.0])) ** 2
        zero, spread = np.zeros(o.shape), (c.DATUM_STD * o.layer) ** 2
        s = State(
            scan, np.where(valid, noise, first_variance), zero, scan, valid, np.where(valid, 0, 1), np.ones(shares),
            variance, spread, np.array([noise, 0.0, 0.0]), 0.0, *o.no_geometry(), surprise=zero,
            surprised=zero.astype(int), dead=zero,
        )  # fmt: skip
        if o.flat:
            term, _, _, shown, freedom = fit_datum(o, scan, 0.0 * scan, valid, spread, max(noise, c.NOISELESS))
            s.noise, s.freedom = self.reading_noise(s, shown, freedom, scan[valid])
            s.datum, s.ground = term, term[:3] * [1.0, 2.0, 2.0]
            s.ground_wrong = np.abs(term[:3]).sum() > c.GROUND_TOLERANCE * o.layer
            s.height, s.variance = zero, np.full(o.shape, c.KNOWN_GROUND)
        s.ledger = s.height
        self.look_at_part(s)
        return s

    def next(
        self, before: State, pattern: Any, layer: int, scan: Any, valid: Any, is_unknown: bool = False,
        factor: Any = 1.0,
    ) -> State:  # fmt: skip
        """After layer number `layer`, factor: volume of each droplet [1]: steps 1 and 2, and what follows."""
        o = self.setup
        s, scan = deepcopy(before), np.where(valid, scan, 0.0)
        s.last, s.last_valid, inks = scan, valid, o.inks(before.share)
        living = np.where(before.dead >= c.DEAD, c.NO_VOLUME, factor)
        full_own = factor * np.append(0.0, inks[:, 0])[pattern]
        predicted = o.printed(before.height, pattern, inks, living)
        adds, squares, own = o.increments(before.height, pattern, inks, living)
        ledger = o.printed(before.ledger, pattern, o.nominal, living)
        variance = before.variance.copy()
        if is_unknown:
            variance += (predicted - before.height) ** 2 / 12.0
            predicted, ledger = (before.height + predicted) / 2.0, (before.ledger + ledger) / 2.0
            adds, squares, own = 0.0 * adds, 0.0 * squares, 0.0 * own
        datum = fit_datum(o, scan, before.height, o.free & valid, s.datum_spread, max(s.noise[0], c.NOISELESS))
        noise, freedom = self.reading_noise(s, datum[3], datum[4], scan[valid])
        if s.scans == 1 and o.noise is None:  # what the first scan was worth
            variance += noise[0] * ((before.unseen == 0) & (variance <= noise[0]) & (before.variance != c.KNOWN_GROUND))
        taken_off = s.datum if datum[3] is None else datum[0]
        flat = np.where(valid, scan - np.tensordot(taken_off, o.terms, 1), 0.0)
        flat, within = levelled(o, s, flat, valid, predicted, variance, noise)
        look = Look(
            before, pattern, flat, valid, predicted, variance, adds, squares, own, full_own, within, datum, is_unknown
        )
        is_scan = valid.sum() >= max(c.LEAST_SEEN * valid.size, 1)
        if not is_scan or (
            not is_unknown and not s.is_looked_at and is_doubted(o, s, before, look, scan, noise[0], layer)
        ):
            s.height, s.unseen = predicted, before.unseen + 1
            s.variance = np.maximum(variance + look.of_droplet * squares, c.LEAST_VARIANCE)
            s.surprise, s.surprised = np.zeros(o.shape), np.zeros(o.shape, int)
        else:
            s.is_looked_at = False
            s.noise, s.freedom = (s.noise, s.freedom) if is_unknown else (noise, freedom)
            self.take_scan(s, before, look, layer)
        s.scans, s.ledger = before.scans + 1, ledger
        self.look_at_part(s)
        return s

    def trust_again(self, before: State) -> State:
        """After a person has looked: the next scan is taken as it is."""
        s = deepcopy(before)
        s.is_volume_believed = s.is_volume_believed or s.stop[0] == c.VOLUME
        s.stop, s.volume_doubt, s.doubts, s.is_looked_at = (0, 0, 0, 0.0), 0.0, np.ones(9), True
        s.variance = np.full(self.setup.shape, c.UNSURE)
        return s

    def figures(self, s: State) -> dict[str, Any]:
        """Reported figures, by the names of `EstimateFigures`."""
        o = self.setup
        std = min(c.DROPLET_STD * np.sqrt(s.early), c.MODEL_MAX)
        if s.early <= c.OTHER_DROPLETS:
            std = c.DROPLET_STD * np.sqrt(s.variation) if s.layers else 0.0
        reason, layer, transform, figure = s.stop
        is_unknown = s.variance > (c.UNKNOWN_HEIGHT * o.layer * o.drop_levels) ** 2
        unseen = int(np.sum(o.part & (s.unseen > o.unseen_layers) & is_unknown))
        marks = [unseen > 0, s.blind > c.BLIND_LAYERS, s.ground_wrong, s.mean_misfit[0] > c.RESIDUALS_MAX]
        marks += [s.full.any(), s.high.any()]
        droplets = o.volume(s.share) * s.ledger
        lack, rise = droplets - s.height, s.height - np.maximum(o.job.target_height, droplets)
        lack, rise = (np.where(o.part, np.maximum(each, 0.0), 0.0) for each in (lack, rise))
        shown = {
            "volume": o.volume(s.share), "droplet_std": std, "noise_std": np.sqrt(s.noise[0]), "ground": s.ground,
            "surprise": np.sqrt(s.mean_misfit[0]), "stop": reason, "stop_layer": layer, "stop_figure": figure,
            "transform": transform, "dead_cells": np.sum(s.dead >= c.DEAD), "capped_cells": np.sum(s.full),
            "unseen_cells": unseen, "scans": s.scans, "reasons": reason + np.sum(marks * 2 ** np.arange(6)),
            "excess": lack.max(), "excess_cell": lack.argmax(), "rise": rise.max(), "rise_cell": rise.argmax(),
            "blind_share": np.mean(~s.last_valid[o.part]),
            "is_foreign": s.mean_misfit[1] > c.SPILL_MAX, "is_displaced": s.is_displaced and bool(s.misfits),
        }  # fmt: skip
        if s.misfits:
            spread, error = s.g[c.SPREAD], np.sqrt(s.covariance[c.SPREAD, c.SPREAD])
            linear = s.g[2:6].reshape(2, 2) / o.half
            shown |= {
                "shift_x": s.g[0], "shift_y": s.g[1], "shift_std": np.sqrt(np.diag(s.covariance)[:2].max()),
                "spot_radius": np.sqrt(spread) * s.is_displaced,
                "spot_std": np.sqrt(spread + error) - np.sqrt(spread),
                "rotation": (linear[1, 0] - linear[0, 1]) / 2.0, "magnification": np.trace(linear) / 2.0,
            }  # fmt: skip
        return shown

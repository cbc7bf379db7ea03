"""The observer of controller/core/observer, stated in NumPy with dense matrices, for small grids.

Heights in metres, geometry in cells. S_g is a matrix (readings, cells); an unknown vector is (geometry, datum, shares).
Grids of at most 1024 cells: the core looks at even distances of larger grounds. Nothing is singular here.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import numpy as np

from support.numpy.observer_constants import (
    BELIEVED,
    CERTAIN,
    DATUM_KEPT,
    DATUM_STD,
    DEAD,
    DEVIATION_MAX,
    DOUBT_KEPT,
    DROPLET_STD,
    EARLY,
    EVIDENCE_MAX,
    FAR_BETTER,
    FOREIGN,
    GROUND_TOLERANCE,
    HIGH,
    KEPT,
    KNOWN_GROUND,
    LARGEST_FOUND,
    LARGEST_VARIATION,
    LATE,
    LAYER_EVIDENCE,
    LEAST_DROPLETS,
    LEAST_ERROR,
    LEAST_EVEN,
    LEAST_GROUND,
    LEAST_SEEN,
    LEAST_SHARE,
    LEAST_SPREAD,
    LEAST_VARIANCE,
    LEAST_VARIATION,
    MEDIAN_SQUARE,
    MODEL_MAX,
    NO_GROWTH,
    NO_VOLUME,
    NOISE_KEPT,
    NOISELESS,
    NOISY,
    NOT_SEEN,
    OF_A_MEDIAN,
    OTHER_DROPLETS,
    OUTLIER,
    READING,
    RESERVE,
    SAME,
    SAME_SCAN,
    SHARE_STD,
    SMOOTH,
    SPIKY,
    SPILL_MAX,
    SPREAD,
    STEEP,
    SURPRISE,
    SUSPICIOUS,
    TURNED,
    TURNS,
    UNIFORM_MEDIAN_SQUARE,
    USUAL,
    VOLUME,
    VOLUME_STD,
    WEAK,
    WHOLE_HEAD,
)  # fmt: skip
from support.numpy.observer_setup import Setup, State, blurred, central, sampling
from support.numpy.scan_fit_numpy import Fit, Look, View, fit_datum, fit_displaced, fit_in_register, may_be_displaced


class Observer:
    """Estimates surface, ink and geometry of the scans of a print, scan by scan; `setup`: grid and options."""

    def __init__(self, setup: Setup) -> None:
        self.setup = setup

    def reading_noise(self, s: State, shown: float | None) -> float:
        o = self.setup
        least = NOISELESS
        if o.noise is not None or shown is None:
            return max(s.noise, least)
        if s.scans == 1:
            return max(shown if o.flat else shown / 2.0, least)
        return max(NOISE_KEPT * s.noise + (1.0 - NOISE_KEPT) * shown, least)

    def cost(self, s: State, scan: Any, valid: Any, expected: Any, even: Any, noise: float, most: float) -> float:
        """Robust mean square of what a scan leaves on even cells, its datum fitted; infinite: too few cells."""
        o = self.setup
        cells = o.free if np.sum(o.free & valid) >= LEAST_GROUND else even
        term = fit_datum(o, scan, expected, cells & valid, s.datum_spread, max(noise, SMOOTH * o.layer**2))[0]
        left = (scan - expected - np.tensordot(term, o.terms, 1))[valid & even]
        return float(np.mean(np.minimum(left**2, most))) if len(left) >= LEAST_EVEN else np.inf

    def is_doubted(self, s: State, before: State, look: Look, scan: Any, layer: int) -> bool:
        """Whether another explanation of the whole scan fits far better; `s` collects the evidence."""
        o = self.setup
        s.doubts = DOUBT_KEPT * s.doubts
        jetted, valid = look.pattern > 0, look.valid
        if not jetted.any():
            return False
        noise = look.noise if s.scans == 1 and not o.flat else s.noise
        share = jetted.sum() / max(o.part.sum(), 1)
        growth = np.mean((look.predicted - before.height)[jetted] ** 2)
        native = noise + look.of_droplet * np.mean(look.own[jetted] ** 2) * max(share, LEAST_SHARE)
        native += np.mean(np.diag(s.share_covariance)) * growth * share
        even = np.sum(central(look.predicted) ** 2, axis=0) < (STEEP * o.layer) ** 2

        def cost(scan: Any, valid: Any, expected: Any) -> float:
            return self.cost(before, scan, valid, expected, even, noise, OUTLIER * native)

        expected, past = (self.read(s, height) for height in (look.predicted, before.height))
        read = cost(scan, valid, expected)
        if not SUSPICIOUS * native < read < np.inf:
            return False
        turns = TURNS if o.shape[0] == o.shape[1] else TURNS[:3]
        costs = [cost(scan, valid, past), cost(scan, valid & before.last_valid, before.last)]
        costs += [cost(turn(scan), turn(valid), expected) for turn in turns]
        best = int(np.argmin(costs))
        if costs[best] >= FAR_BETTER * read:
            return False
        s.doubts[best] += 1.0
        is_stuck = best < 2
        if s.stop[0] == 0 and (s.doubts[:2].sum() if is_stuck else s.doubts[best]) >= BELIEVED:
            both = valid & before.last_valid
            is_last = noise > NOISY and np.array_equal(scan[both], before.last[both])
            stuck = LATE if costs[1] >= FAR_BETTER * read else SAME_SCAN if is_last else NO_GROWTH
            figure = float(np.sqrt(read / max(costs[best], noise)))
            s.stop = (stuck if is_stuck else TURNED, layer, 0 if is_stuck else best, figure)
        return True

    def read(self, s: State, height: Any) -> Any:
        """What the sensor reads of a surface by what is believed of it."""
        o = self.setup
        if not s.is_displaced:
            return height
        return (sampling(o.shape, *o.places(s.g)) @ blurred(height, s.g[SPREAD]).ravel()).reshape(o.shape)

    def take_scan(self, s: State, before: State, look: Look) -> None:
        o = self.setup
        is_registered, walls, with_spot = o.registered and not look.is_unknown, look.valid, look.predicted
        in_register = fit = displaced = fit_in_register(o, look)
        if is_registered:
            displaced, walls, with_spot = fit_displaced(o, s, look, in_register)
            fit = displaced if s.is_displaced else in_register
        may_be = is_registered and bool(s.misfits) and may_be_displaced(s)
        is_robust = may_be or fit.misfit.max() < FOREIGN
        extra = np.append(np.maximum(fit.misfit - USUAL, 0.0) * (not may_be and not s.is_displaced), 0.0)
        known = np.maximum(
            look.variance + look.of_droplet * look.squares + extra[look.classes] * look.native, LEAST_VARIANCE
        )
        left = np.tensordot(fit.datum, o.terms, 1)
        of_datum = np.maximum(np.einsum("aij,ab,bij->ij", o.terms, fit.datum_covariance, o.terms), 0.0)
        change = look.change(fit.share)
        if s.is_displaced:
            view = View(o, look, np.ones(o.shape, np.bool_), s.g[SPREAD])
            view.look(np.concatenate([s.g, np.zeros(6), [] if o.model == "off" else s.share]))
            S = view.S
            rest = look.scan - left - (view.averaged.ravel() @ S.T + change.ravel() @ S.T).reshape(o.shape)
            of_geometry = (
                np.einsum("ra,ab,rb->r", view.J[:, :7], s.covariance, view.J[:, :7]) + READING**2 * view.slopes
            )
            spread, error = (
                (S @ known.ravel()).reshape(o.shape),
                look.noise + of_datum + of_geometry.reshape(o.shape),
            )
        else:
            rest, spread, error = look.scan - left - look.predicted - change, known, look.noise + of_datum
            if may_be:
                x, y = central(look.predicted)
                J = np.stack([x, y, x * o.u, x * o.w, y * o.u, y * o.w, with_spot])
                doubtful = s.covariance + np.outer(s.g, s.g)
                error = error + np.where(walls, np.einsum("aij,ab,bij->ij", J, doubtful, J), 0.0)
        weight, jump, vanished = self.believed(s, before, look, rest, spread + error, is_robust)
        weak = np.maximum((spread + error) / np.maximum(weight, 1e-9) - spread, LEAST_ERROR)
        weight = np.where(look.valid, 1.0 / weak, 0.0)
        known = known + jump
        if s.is_displaced:
            back = sampling(o.shape, *self.back(s.g))
            seen = (back @ weight.ravel()).reshape(o.shape)
            is_seen = seen * known > NOT_SEEN
            rest = np.where(
                is_seen, (back @ (weight * rest).ravel()).reshape(o.shape) / np.where(is_seen, seen, 1.0), 0.0
            )
            weight = np.where(is_seen, seen, 0.0)
            variance = known + 1.0 / np.where(is_seen, seen, np.inf)
        else:
            is_seen, rest, variance = look.valid, np.where(look.valid, rest, 0.0), spread + error
        s.unseen = np.where(is_seen, 0, before.unseen + 1)
        s.height = look.predicted + change + known * weight / (1.0 + known * weight) * rest
        s.variance = known / (1.0 + known * weight)
        if look.is_unknown:
            return
        s.dead = self.dead(before, look, is_seen, rest, variance)
        s.vanishing = 0.9 * s.vanishing + 0.1 * vanished / max(look.valid.sum(), 1)
        is_better = may_be and displaced.droplets >= LEAST_DROPLETS and displaced.misfit[0] < in_register.misfit[0]
        self.learn(s, look, displaced if s.is_displaced or is_better else in_register, fit)

    def back(self, g: Any) -> tuple[Any, Any]:
        """Where on the scan the reading of each cell lies."""
        o = self.setup
        linear = np.eye(2) + g[2:6].reshape(2, 2) / o.half
        inner = np.stack([o.i - o.half[0] - g[0], o.j - o.half[1] - g[1]])
        x, y = np.tensordot(np.linalg.inv(linear), inner, 1)
        return x + o.half[0], y + o.half[1]

    def believed(
        self, s: State, before: State, look: Look, rest: Any, variance: Any, is_robust: bool
    ) -> tuple[Any, Any, int]:
        """(weights of the readings, variances by which cells have jumped, surprises that have vanished)."""
        square, told = rest**2 / variance, before.surprise
        weight = 1.0 / (1.0 + np.exp(np.minimum((square - SURPRISE**2) / 2.0, 60.0)))
        weight = np.where((square > SURPRISE**2 / 2.0) & is_robust, weight, 1.0)
        is_big = weight < CERTAIN
        is_same = is_big & (told * rest > 0.0) & (np.abs(told) > SAME * np.abs(rest))
        times = np.where(is_same, before.surprised + 1, is_big)
        is_real = look.valid & is_same & (times >= (3 if before.vanishing > SPIKY else 2))
        s.surprise = np.where(look.valid & is_big & ~is_real, rest, 0.0)
        s.surprised = np.where(look.valid & ~is_real, times, 0)
        vanished = int(np.sum(look.valid & (told != 0.0) & ~is_big))
        return np.where(is_real, 1.0, weight), np.where(is_real, rest**2, 0.0), vanished

    def dead(self, before: State, look: Look, is_seen: Any, rest: Any, variance: Any) -> Any:
        """Evidence that nothing comes, against a weak droplet."""
        o = self.setup
        grown = rest + np.where(before.dead < DEAD, look.own, 0.0)
        weak, least = WEAK * look.full_own, np.maximum(np.minimum(variance, look.full_own**2), LEAST_VARIANCE)
        evidence = np.where(is_seen & (look.full_own > 0.0), weak * (weak / 2.0 - grown) / least, 0.0)
        if np.sum(evidence > 0.0) > WHOLE_HEAD * o.part.sum():
            return before.dead
        return np.clip(before.dead + np.clip(evidence, -LAYER_EVIDENCE, LAYER_EVIDENCE), 0.0, DEAD)

    def learn(self, s: State, look: Look, fit: Fit, believed: Fit) -> None:
        """Variance of droplets, spread of the datum, shares."""
        own = DROPLET_STD**2 * fit.squares
        if fit.droplets >= LEAST_DROPLETS and own > 0.0:
            found = max(LEAST_VARIATION, s.variation + (fit.misfit[0] - 1.0) * (fit.base + s.variation * own) / own)
            share = max(found, s.variation) * own / (fit.base + max(found, s.variation) * own)
            kept, freedom = KEPT * s.evidence, OF_A_MEDIAN * fit.droplets * share**2
            mean = (kept * s.variation + freedom * min(found, LARGEST_FOUND)) / (kept + freedom)
            s.variation, s.evidence = min(mean, LARGEST_VARIATION), min(kept + freedom, EVIDENCE_MAX)
            s.layers += 1
            s.residual = KEPT * s.residual + (1.0 - KEPT) * found
            s.mean_misfit = KEPT * s.mean_misfit + (1.0 - KEPT) * fit.misfit
            if s.layers <= EARLY:
                s.early += (found - s.early) / s.layers
        if look.datum[3] is not None:
            square = np.maximum((look.datum[0] + believed.datum) ** 2, LEAST_SPREAD)
            s.datum_spread = DATUM_KEPT * s.datum_spread + (1.0 - DATUM_KEPT) * square
        s.share, s.share_covariance = believed.share, believed.share_covariance

    def look_at_part(self, s: State, layer: int | None) -> None:
        """Volume beyond belief, where a layer was scanned; cells that are capped, and that stand too high."""
        o = self.setup
        volume = o.volume(s.share)
        if layer is not None:
            s.volume_doubt *= DOUBT_KEPT
            is_known = o.model == "scale" and np.mean(np.diag(s.share_covariance)) < VOLUME_STD**2
            s.volume_doubt += is_known and not o.least <= volume <= o.most
            if is_known and not o.least <= volume <= o.most and s.stop[0] == 0 and s.volume_doubt >= BELIEVED:
                s.stop = (VOLUME, layer, 0, volume)
        target = o.job.target_height
        s.capped = o.part & (o.least * s.ledger > target + RESERVE * o.layer)
        s.high = o.part & (s.height - np.maximum(target, volume * s.ledger) > HIGH * o.layer)

    def first(self, scan: Any, valid: Any) -> State:
        """Of layer 0."""
        o = self.setup
        noise, shares, scan = o.noise or 0.0, o.orders * len(o.nominal), np.where(valid, scan, 0.0)
        variance = (SHARE_STD.get(o.model, 0.0) ** 2) * np.eye(shares)
        first_variance = float(np.mean(o.nominal @ [1.0, 4.0, 4.0])) ** 2
        zero, spread = np.zeros(o.shape), (DATUM_STD * o.layer) ** 2
        s = State(
            scan, np.where(valid, noise, first_variance), zero, scan, valid, np.where(valid, 0, 1), np.ones(shares),
            variance, spread, noise, *o.no_geometry(), surprise=zero, surprised=zero.astype(int), dead=zero,
        )  # fmt: skip
        if o.flat:
            term, _, _, shown = fit_datum(o, scan, 0.0 * scan, valid, spread, max(noise, NOISELESS))
            s.noise = max(shown or 0.0, NOISELESS) if o.noise is None else noise
            s.ground, s.ground_wrong = (
                term[:3] * [1.0, 2.0, 2.0],
                np.abs(term[:3]).sum() > GROUND_TOLERANCE * o.layer,
            )
            s.height, s.variance = zero, np.full(o.shape, KNOWN_GROUND)
        s.ledger = s.height
        self.look_at_part(s, None)
        return s

    def next(self, before: State, pattern: Any, layer: int, scan: Any, valid: Any, is_unknown: bool = False) -> State:
        o = self.setup
        s, scan = deepcopy(before), np.where(valid, scan, 0.0)
        s.last, s.last_valid, inks = scan, valid, o.inks(before.share)
        living = np.where(before.dead >= DEAD, NO_VOLUME, 1.0)
        full_own = np.append(0.0, inks[:, 0])[pattern]
        predicted = o.printed(before.height, pattern, inks, living)
        adds, squares, own = o.increments(before.height, pattern, inks, living)
        ledger, variance = o.printed(before.ledger, pattern, o.nominal, living), before.variance.copy()
        if is_unknown:
            variance += (predicted - before.height) ** 2 / 12.0
            predicted, ledger = (before.height + predicted) / 2.0, (before.ledger + ledger) / 2.0
            adds, squares, own = 0.0 * adds, 0.0 * squares, 0.0 * own
        datum = fit_datum(o, scan, before.height, o.free & valid, s.datum_spread, max(s.noise, NOISELESS))
        noise = self.reading_noise(s, datum[3])
        if s.scans == 1 and o.noise is None:  # what the first scan was worth
            variance += noise * ((before.unseen == 0) & (variance <= noise) & (before.variance != KNOWN_GROUND))
        flat = np.where(valid, scan - np.tensordot(datum[0], o.terms, 1), 0.0)
        look = Look(
            before, pattern, flat, valid, predicted, variance, adds, squares, own, full_own, noise, datum, is_unknown
        )
        is_scan = valid.sum() >= max(LEAST_SEEN * valid.size, 1)
        if not is_scan or (not is_unknown and not s.is_looked_at and self.is_doubted(s, before, look, scan, layer)):
            s.height, s.unseen = predicted, before.unseen + 1
            s.variance = np.maximum(variance + look.of_droplet * squares, LEAST_VARIANCE)
            s.surprise, s.surprised = np.zeros(o.shape), np.zeros(o.shape, int)
        else:
            s.is_looked_at, s.noise = False, s.noise if is_unknown else noise
            self.take_scan(s, before, look)
        s.scans, s.ledger = before.scans + 1, ledger
        self.look_at_part(s, None if is_unknown else layer)
        return s

    def figures(self, s: State) -> dict[str, Any]:
        """What is reported, by the names of `EstimateFigures`."""
        o = self.setup
        found = DROPLET_STD * float(np.sqrt(s.residual * MEDIAN_SQUARE / UNIFORM_MEDIAN_SQUARE))
        model = DROPLET_STD * float(np.sqrt(s.early))
        std = min(model, MODEL_MAX) if s.early > OTHER_DROPLETS else min(found, DEVIATION_MAX) if s.layers else 0.0
        reason, layer, transform, figure = s.stop
        shown = {
            "volume": o.volume(s.share), "droplet_std": std, "noise_std": np.sqrt(s.noise), "ground": s.ground,
            "surprise": np.sqrt(s.mean_misfit[0]), "stop": reason, "stop_layer": layer, "stop_figure": figure,
            "transform": transform, "dead_cells": np.sum(s.dead >= DEAD), "capped_cells": np.sum(s.capped),
            "unseen_cells": np.sum(s.unseen[o.part] > o.unseen_layers), "scans": s.scans,
            "is_foreign": s.mean_misfit[1] > SPILL_MAX, "is_displaced": s.is_displaced and bool(s.misfits),
        }  # fmt: skip
        if s.misfits:
            spread, error = max(s.g[SPREAD], 0.0), np.sqrt(s.covariance[SPREAD, SPREAD])
            linear = s.g[2:6].reshape(2, 2) / o.half
            shown |= {
                "shift_x": s.g[0], "shift_y": s.g[1], "shift_std": np.sqrt(np.diag(s.covariance)[:2].max()),
                "spot_radius": np.sqrt(spread) if s.is_displaced and spread > 2.0 * error else 0.0,
                "spot_std": np.sqrt(spread + error) - np.sqrt(spread),
                "rotation": (linear[1, 0] - linear[0, 1]) / 2.0, "magnification": np.trace(linear) / 2.0,
            }  # fmt: skip
        return shown

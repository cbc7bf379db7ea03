"""Whole scans that do not show what was printed, stated in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from support.numpy import observer_constants as c
from support.numpy.observer_setup import Setup, State, blurred, central, sampling
from support.numpy.scan_fit_numpy import Look, fit_datum


def cost_of(o: Setup, s: State, scan: Any, valid: Any, expected: Any, even: Any, noise: float, most: float) -> float:
    """Robust mean square of what a scan leaves on even cells, its datum fitted; infinite: too few cells."""
    cells = o.free if np.sum(o.free & valid) >= c.LEAST_GROUND else even
    term = fit_datum(o, scan, expected, cells & valid, s.datum_spread, max(noise, c.SMOOTH * o.layer**2))[0]
    left = (scan - expected - np.tensordot(term, o.terms, 1))[valid & even]
    return float(np.mean(np.minimum(left**2, most))) if len(left) >= c.LEAST_EVEN else np.inf


def reading_of(o: Setup, s: State, height: Any) -> Any:
    """Readings of a surface by the sensor with the believed geometry."""
    if not s.is_displaced:
        return height
    g = s.g
    return (sampling(o.shape, *o.places(g)) @ blurred(height, g[c.SPREAD]).ravel()).reshape(o.shape)


def is_doubted(o: Setup, s: State, before: State, look: Look, scan: Any, first: float, layer: int) -> bool:
    """Whether another explanation of the whole scan fits far better; `s` collects the evidence.

    first: noise of a reading as the second scan shows it [m^2].
    """
    s.doubts = c.DOUBT_KEPT * s.doubts
    jetted, valid = look.pattern > 0, look.valid
    if not jetted.any():
        return False
    noise = first if s.scans == 1 and not o.flat else s.noise[0]
    share = jetted.sum() / max(o.part.sum(), 1)
    growth = np.mean((look.predicted - before.height)[jetted] ** 2)
    native = noise + look.of_droplet * np.mean(look.own[jetted] ** 2) * max(share, c.LEAST_SHARE)
    native += np.mean(np.diag(s.share_covariance)) * growth * share
    even = np.sum(central(look.predicted) ** 2, axis=0) < min((c.STEEP * o.layer) ** 2, native / before.steps.max())

    def cost(scan: Any, valid: Any, expected: Any) -> float:
        return cost_of(o, before, scan, valid, expected, even, noise, c.OUTLIER * native)

    expected, past = (reading_of(o, s, height) for height in (look.predicted, before.height))
    read = cost(scan, valid, expected)
    if not c.SUSPICIOUS * native < read < np.inf:
        return False
    turns = c.TURNS if o.shape[0] == o.shape[1] else c.TURNS[:3]
    both = valid & before.last_valid
    costs = [cost(scan, valid, past), cost(scan, both, before.last)]
    if costs[1] >= c.FAR_BETTER * cost(scan, both, before.last + expected - past):
        costs[1] = np.inf
    if jetted.sum() < c.LEAST_DROPLETS:
        costs = [np.inf, np.inf]
    costs += [cost(turn(scan), turn(valid), expected) for turn in turns]
    best = int(np.argmin(costs))
    is_stuck = best < 2
    most = c.STUCK * read + c.STUCK_NOISE * noise if is_stuck else np.inf
    if costs[best] >= min(c.FAR_BETTER * read, most):
        return False
    s.doubts[best] += 1.0
    if s.stop[0] == 0 and (s.doubts[:2].sum() if is_stuck else s.doubts[best]) >= c.BELIEVED:
        is_last = noise > c.NOISY and np.array_equal(scan[both], before.last[both])
        stuck = c.LATE if costs[1] >= c.FAR_BETTER * read else c.SAME_SCAN if is_last else c.NO_GROWTH
        figure = float(np.sqrt(read / max(costs[best], noise, c.NOISELESS)))
        s.stop = (stuck if is_stuck else c.TURNED, layer, 0 if is_stuck else best, figure)
    return True

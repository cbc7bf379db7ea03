"""The robust fits of a scan, stated in NumPy: its datum; ink in register; ink and geometry displaced."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import norm

from support.numpy import observer_constants as c
from support.numpy.observer_setup import (
    Setup,
    State,
    blurred,
    central,
    inverse,
    misfit,
    near,
    sampling,
    scatter,
    solved,
    upper_misfit,
    variance_within,
)


@dataclass
class Fit:
    """Shares, the datum left, and what they leave: misfit of cells with a droplet and of their neighbours.

    scatter: of cells with a droplet, outliers left out.
    """

    share: Any
    share_covariance: Any
    datum: Any
    datum_covariance: Any
    misfit: Any
    scatter: float = 1.0
    droplets: int = 0
    base: float = 0.0
    squares: float = 0.0

    @property
    def is_misfit(self) -> bool:
        return bool(self.misfit.max() >= c.FOREIGN)


@dataclass
class Look:
    """A scan with all that is known before it; adds: (shares, nx, ny), what a change of each share by 1 adds [m]."""

    state: State
    pattern: Any
    scan: Any
    valid: Any
    predicted: Any
    variance: Any
    adds: Any
    squares: Any
    own: Any
    full_own: Any
    noise: float
    datum: tuple[Any, Any, Any, float | None, Any]
    is_unknown: bool

    def __post_init__(self) -> None:
        self.of_droplet = c.DROPLET_STD**2 * self.state.variation
        self.native = self.noise + self.variance + self.of_droplet * self.squares
        self.reached = self.valid & (self.squares > 0.0)
        self.classes = np.where(self.pattern > 0, 0, np.where(self.squares > 0.0, 1, 2))

    def change(self, share: Any) -> Any:
        """(nx, ny): what other shares than those known add."""
        return np.tensordot(share - self.state.share, self.adds, 1)

    def rest(self, fit: Fit, terms: Any) -> Any:
        """(nx, ny): what a fit in register leaves of the scan."""
        return self.scan - self.predicted - self.change(fit.share) - np.tensordot(fit.datum, terms, 1)


class View:
    """Readings of a displaced sensor on some cells, linear in the unknowns about x."""

    def __init__(self, setup: Setup, look: Look, cells: Any, spread: float, share: Any) -> None:
        self.setup, self.data, self.cells, self.step = setup, look, cells, c.SLOPE_STEP
        self.average(spread, share)

    def average(self, spread: float, share: Any) -> None:
        self.spread, self.share = max(spread, 0.0), share
        expected = self.data.predicted + self.data.change(share)
        self.averaged = blurred(expected, self.spread)
        self.with_spot = (blurred(expected, self.spread + c.SPOT_STEP) - self.averaged) / c.SPOT_STEP

    def is_averaged(self, x: Any) -> bool:
        """Whether readings are linear from the averaged prediction on: what ink changes is not averaged."""
        off = np.abs(x[13:] - self.share[: len(x) - 13]).max(initial=0.0) * min(x[c.SPREAD], 1.0)
        return bool(abs(x[c.SPREAD] - self.spread) <= c.SAME_SPREAD and off <= c.SAME_SHARE)

    def look(self, x: Any) -> None:
        """Rests, their variances and classes, and the matrix J of what the unknowns change."""
        o, data, cells = self.setup, self.data, self.cells
        at = np.stack(o.places(x[:7]))[:, cells]
        self.S = S = sampling(o.shape, *at)

        def averaged(at: Any) -> Any:
            return sampling(o.shape, *at) @ self.averaged.ravel()

        steps = self.step * np.eye(2)[:, :, None]
        slope = [(averaged(at + step) - averaged(at - step)) / (2.0 * self.step) for step in steps]
        u, w, terms = o.u[cells], o.w[cells], o.terms[:, cells]
        geometry = [*slope, *(each * place for each in slope for place in (u, w)), S @ self.with_spot.ravel()]
        shares = [S @ add.ravel() for add in data.adds[: len(x) - 13]]
        self.J = np.stack([*geometry, *terms, *shares], axis=1)
        change = np.concatenate([[x[c.SPREAD] - self.spread], x[7:13], x[13:] - self.share[: len(x) - 13]])
        self.rest = data.scan[cells] - S @ self.averaged.ravel() - self.J[:, c.SPREAD :] @ change
        self.slopes, self.squares = slope[0] ** 2 + slope[1] ** 2, S @ data.squares.ravel()
        self.own_variance = c.OF_SLOPE**2 * self.slopes + (c.OF_SPOT * x[c.SPREAD] * self.J[:, c.SPREAD]) ** 2
        self.own_variance += border_variance(o, data.predicted, S @ self.averaged.ravel(), at, self.spread)
        native = (data.variance + data.of_droplet * data.squares).ravel()
        self.variance = data.noise + self.own_variance + S @ native
        is_own = np.any((S > 0.0) & (data.pattern.ravel() > 0), axis=1)
        self.classes = np.where(is_own, 0, np.where(self.squares > 0.0, 1, 2))


def border_variance(o: Setup, height: Any, reading: Any, at: Any, spread: float) -> Any:
    """Variance of readings whose spot reaches beyond the grid, where the surface may continue or not count."""
    total = np.zeros(np.shape(reading))
    for axis, end in np.ndindex(2, 2) if spread >= c.POINT else ():
        last = o.shape[axis] - 1.0
        away = last - at[axis] if end else at[axis]
        border = at.copy()
        border[axis] = end * last
        share = norm.sf((np.maximum(away, 0.0) + 0.5) / np.sqrt(spread))
        off = share / (1.0 - share) * (reading - sampling(o.shape, *border) @ height.ravel())
        total += np.where(away < c.BORDER * np.sqrt(spread), off**2, 0.0)
    return total


def fit_datum(
    o: Setup, scan: Any, known: Any, cells: Any, spread: Any, noise: float
) -> tuple[Any, Any, Any, Any, float]:
    """(terms, covariance, precision, variances of readings, degrees of freedom): a robust fit on cells that show it.

    Variances: about the datum, and by neighbours along x and along y; None where too few cells show it.
    """
    A, rise, variance = o.terms[:, cells].T, (scan - known)[cells], max(noise, c.NOISELESS)
    if len(A) < c.LEAST_GROUND:
        return np.zeros(6), np.zeros((6, 6)), np.eye(6) / c.SURELY, None, 0.0
    weight = np.ones(len(A))
    for _ in range(6):
        N = (A.T * weight / variance) @ A + np.diag(1.0 / spread)
        term = solved(N, A.T @ (weight * rise) / variance)
        rest = rise - A @ term
        found = variance_within(rest**2)
        scale = max(found, c.NOISELESS)
        variance = max((variance + scale) / 2.0, c.NOISELESS)
        weight = (c.NU + 1.0) / (c.NU + rest**2 / scale)
    freedom = float(len(A) - np.sum(1.0 - np.diag(inverse(N)) / spread))
    noises = np.full(3, max(found * len(A) / freedom, c.NOISELESS))
    left = scan - known - np.tensordot(term, o.terms, 1)
    for axis in (0, 1):
        step = np.diff(left, axis=axis)[
            np.moveaxis(np.moveaxis(cells, axis, 0)[1:] & np.moveaxis(cells, axis, 0)[:-1], 0, axis)
        ]
        if len(step) >= c.LEAST_GROUND:
            noises[1 + axis] = variance_within(step**2 / 2.0)
    return term, inverse(N), N, noises, freedom


def levelled(o: Setup, s: State, scan: Any, valid: Any, predicted: Any, variance: Any, noise: Any) -> tuple[Any, float]:
    """(scan without the offsets of its lines, noise left to a reading), by the cells that no droplet reaches."""
    within, excess = max(noise[1:].min(), o.steps, c.NOISELESS), noise[1] - noise[2]
    spread, lines = abs(excess), 1 if excess > 0.0 else 0
    if spread <= c.LINES_TELL * within:
        return scan, noise[0]
    g, shift = s.g, np.diag(s.covariance)[:2].max()
    expected = predicted
    if s.is_displaced:
        expected = (sampling(o.shape, *o.places(g)) @ blurred(predicted, g[c.SPREAD]).ravel()).reshape(o.shape)
    else:
        shift += np.max(g[:2] ** 2)
    rest, own = scan - expected, within + variance + o.registered * shift * np.sum(central(predicted) ** 2, axis=0)
    shows = valid & ~near(o.part)
    weight = shows * (c.NU + 1.0) * (own + spread) / ((c.NU * (own + spread) + rest**2) * own)
    left = 1.0 / (weight.sum(axis=lines) + 1.0 / spread)
    offset, reached = left * (weight * rest).sum(axis=lines), near(o.part).sum(axis=lines)
    return scan - valid * np.expand_dims(offset, lines), within + float(np.sum(reached * left) / max(reached.sum(), 1))


def smooth_prior(o: Setup, look: Look) -> Any:
    """Precision of datum and shares before the scan."""
    shares = 0 if o.model == "off" else len(look.state.share)
    precision = np.pad(look.datum[2], (0, shares))
    if shares:
        inks = 1 + np.arange(shares) // (3 if o.model == "full" else 1)
        printed = [min(1.0, np.sum(look.pattern == ink) / max(1, np.sum(o.part))) for ink in inks]
        is_held = o.model == "full" and look.state.is_displaced
        together = np.equal.outer(inks, inks) if is_held else np.eye(shares)
        step = c.SHARE_STEP["scale" if is_held else o.model]
        precision[6:, 6:] = inverse(look.state.share_covariance + step**2 * together * printed)
    return precision


def smooth_sums(o: Setup, look: Look, cells: Any, misfit: Any) -> tuple[Any, Any]:
    """Normal equations (matrix, side) of datum and changes of the shares by cells in register."""
    columns = o.terms if o.model == "off" else np.concatenate([o.terms, look.adds])
    A, rest = columns[:, cells].T, (look.scan - look.predicted)[cells]
    wide = (np.append(np.maximum(misfit, 1.0), 1.0)[look.classes] * look.native)[cells]
    weight = (c.NU + 1.0) / (c.NU * wide + rest**2)
    return (A.T * weight) @ A, A.T @ (weight * rest)


def fitted(o: Setup, look: Look, x: Any, covariance: Any) -> Fit:
    """Fitted datum and shares (not their changes)."""
    if o.model == "off":
        return Fit(look.state.share, look.state.share_covariance, x[:6], covariance[:6, :6], np.ones(2))
    return Fit(np.clip(x[6:], *c.SHARE_RANGE), covariance[6:, 6:], x[:6], covariance[:6, :6], np.ones(2))


def fit_in_register(o: Setup, look: Look) -> Fit:
    """Where droplets are foreign a second time, with variances as large as what they leave."""
    wider = np.ones(2)
    for _ in range(2):
        matrix, side = smooth_sums(o, look, look.reached, wider)
        matrix = matrix + smooth_prior(o, look)
        x = solved(matrix, side)
        x[6:] += look.state.share[: len(x) - 6]
        fit = fitted(o, look, x, inverse(matrix))
        squares, own = look.rest(fit, o.terms) ** 2 / look.native, look.reached & (look.pattern > 0)
        fit.misfit = np.array([misfit(squares[own]), misfit(squares[look.reached & ~own])])
        fit.scatter, fit.droplets = scatter(squares[own]), int(own.sum())
        if own.any():
            fit.base, fit.squares = np.mean((look.noise + look.variance)[own]), np.mean(look.squares[own])
        if not fit.is_misfit:
            break
        wider = fit.misfit
    return fit


def marked_walls(o: Setup, s: State, look: Look, prior: Any) -> Any:
    """Cells that the geometry may move."""
    if s.is_displaced:
        return np.ones(o.shape, np.bool_)
    spread = max(prior[0, 0] + prior[2, 2] + prior[3, 3], prior[1, 1] + prior[4, 4] + prior[5, 5])
    least = c.WALL * (look.noise + look.of_droplet * o.nominal[0, 0] ** 2) / spread
    steep = np.sum(central(look.predicted) ** 2, axis=0) > least
    return near(steep, 3 if spread > 0.25 else 2 if spread > 0.06 else 1)


def without_spot(least: float, covariance: Any, x: Any) -> Any:
    """Unknowns given that there is no spot, if its variance is below `least`."""
    of_spot = covariance[c.SPREAD] / covariance[c.SPREAD, c.SPREAD]
    return x - of_spot * x[c.SPREAD] if x[c.SPREAD] < least else x


def fit_displaced(o: Setup, s: State, look: Look, in_register: Fit) -> tuple[Fit, Any, Any]:
    """(fit of the scan as displaced, walls, slope with the spot); `s` learns the geometry."""
    step = np.concatenate([np.sqrt(s.steps), c.LINEAR_STEP * np.tile(o.half, 2), [c.SPREAD_STEP]])
    prior = s.covariance + np.diag(step**2)
    walls, fit = marked_walls(o, s, look, prior), deepcopy(in_register)
    fit.droplets = 0
    cells = look.valid & walls
    if s.odds < c.IN_REGISTER:
        chosen = np.flatnonzero(cells)
        cells = np.zeros_like(cells)
        cells.flat[chosen[:: max(1, -(-len(chosen) // c.WATCHED))]] = True
    view = View(o, look, cells, s.g[c.SPREAD], s.share)
    if cells.sum() < c.LEAST_CELLS:
        return fit, walls, view.with_spot
    before = np.concatenate([s.g, np.zeros(6), [] if o.model == "off" else s.share])
    precision = np.zeros((len(before), len(before)))
    precision[:7, :7], precision[7:, 7:] = inverse(prior), smooth_prior(o, look)
    wider = in_register.misfit if in_register.is_misfit else np.ones(2)
    others = smooth_sums(o, look, look.reached & ~walls, wider)

    def equations(x: Any, heat: float) -> tuple[Any, Any]:
        weight = (c.NU + 1.0) / (c.NU * heat * view.variance + view.rest**2)
        matrix = precision + (view.J.T * weight) @ view.J
        matrix[7:, 7:] += others[0]
        side = precision @ (before - x) + view.J.T @ (weight * view.rest)
        side[7:] += others[1] - others[0] @ (x - before)[7:]
        return matrix, side

    def cost(x: Any) -> float:
        view.look(x)
        prior_cost = np.sum((x - before)[:2] ** 2 / np.diag(prior)[:2]) / 2.0
        return float((c.NU + 1.0) / 2.0 * np.sum(np.log1p(view.rest**2 / (c.NU * view.variance))) + prior_cost)

    x, shift_variance = before.copy(), max(prior[0, 0], prior[1, 1])
    if shift_variance >= c.UNKNOWN_SHIFT**2:
        moves = np.argwhere(np.ones((2 * c.TRIED + 1, 2 * c.TRIED + 1))) - c.TRIED
        tried = [x + np.pad(move, (0, len(x) - 2)) for move in moves]
        x = tried[int(np.argmin([cost(each) for each in tried]))]
    for number in range(c.ROUNDS):
        if not view.is_averaged(x):
            view.average(x[c.SPREAD], s.share if o.model == "off" else x[13:])
        view.step = max(c.SHORT_STEP, c.SLOPE_STEP * c.SHORTER**number)
        view.look(x)
        hot = view.slopes * shift_variance > 4.0 * view.variance
        is_hot = number + c.COLD < c.ROUNDS and hot.sum() > c.LEAST_CELLS // 2
        heat = float(np.median((view.rest**2 / view.variance)[hot])) / c.MEDIAN_SQUARE if is_hot else 1.0
        matrix, side = equations(x, max(heat, 1.0))
        last, x = x, without_spot(0.0, inverse(matrix), x + solved(matrix, side))
        x[:7] = np.clip(x[:7], last[:7] - c.LONGEST_MOVE, last[:7] + c.LONGEST_MOVE)
        x[c.SPREAD], x[13:] = min(x[c.SPREAD], c.LARGEST_SPREAD), np.clip(x[13:], *c.SHARE_RANGE)
        if heat <= 1.0 and np.abs(x - last)[:7].max() < c.CONVERGED:
            break
    view.look(x)
    covariance = inverse(equations(x, 1.0)[0])
    x = without_spot(2.0 * np.sqrt(covariance[c.SPREAD, c.SPREAD]), covariance, x)
    view.look(x)
    fit, squares = fitted(o, look, x[7:], covariance[7:, 7:]), view.rest**2 / view.variance
    fit.misfit = np.array([misfit(squares[view.classes == k]) for k in (0, 1)])
    is_steep = view.slopes > (c.STEEP * o.layer) ** 2
    groups, own = [squares[each] for each in (is_steep, view.classes == 0, view.classes == 1)], view.classes == 0
    left = max(1.0, *map(misfit, groups), *(() if s.is_displaced else map(upper_misfit, groups)))
    if own.sum() >= c.LEAST_CELLS:
        fit.scatter, fit.droplets, fit.squares = scatter(squares[own]), int(own.sum()), np.mean(view.squares[own])
        fit.base = np.mean(view.variance[own]) - look.of_droplet * fit.squares
    variance = c.NU * np.minimum(view.variance, look.native[cells])
    plain = min(np.sum(np.log1p(look.rest(one, o.terms)[cells] ** 2 / variance)) for one in (in_register, fit))
    gained = (c.NU + 1.0) / 2.0 * (plain - np.sum(np.log1p(view.rest**2 / variance)))
    learn_geometry(s, x, covariance, left, gained)
    return fit, walls, view.with_spot


def may_be_displaced(s: State) -> bool:
    return float(np.median(s.misfits[-3:])) < c.FOREIGN


def learn_geometry(s: State, x: Any, covariance: Any, left: float, gained: float) -> None:
    s.misfits = [*s.misfits, left]
    s.odds = float(np.clip(s.odds + c.TEMPER * gained - c.PRICE, *c.ODDS_RANGE))
    may_be = may_be_displaced(s)
    if len(s.misfits) > 1 and may_be:
        steps = (1.0 - c.STEP_GAIN) * s.steps + c.STEP_GAIN * (x - np.pad(s.g, (0, len(x) - 7)))[:2] ** 2
        s.steps = np.maximum(steps, c.LEAST_STEP**2)
    stands_out = bool(np.any(x[:2] ** 2 > c.STANDS_OUT**2 * left * (np.diag(covariance)[:2] + c.OF_SLOPE**2)))
    s.is_shifted |= s.odds > c.DECIDED and not may_be and stands_out and len(s.misfits) <= 3
    s.is_displaced = s.odds > c.DECIDED and (may_be or s.is_shifted)
    s.g, s.covariance = x[:7].copy(), covariance[:7, :7].copy()
    if s.is_displaced and not may_be:
        s.g[2:] = 0.0

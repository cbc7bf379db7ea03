"""The layer problem linearised around some droplets: a linear program for HiGHS, built once and solved around many."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, TypeAlias

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.statement import HorizonStatement, LayerSymbols, jet, surface_cost

Cells: TypeAlias = NDArray[np.float64]
"""A map as one column, in the order in which CasADi stacks it: (i, j) at j * nx + i."""

LEAST_DEVIATION_UM = 1e-3  # the parabola over the deviation is no narrower: a 7,600th of a layer (assumed)
METHODS = ({"solver": "ipm", "run_crossover": "on"}, {"solver": "simplex"})
"""Options of HiGHS; the second where the first fails. Interior points with crossover take half of the time of simplex
on 25 x 25 nearly flat cells three layers ahead; without crossover they fail more often.
"""


@dataclass(frozen=True, eq=False)
class Point:
    """Droplets of each layer, the surface after each step [um] with its derivatives, and the objective [um].

    by_surface, by_droplets: of each step, (cells, cells) by the surface before it and by the droplets of its layer.
    """

    droplets: Sequence[Cells]
    surfaces: Sequence[Cells]
    by_surface: Sequence[Any]
    by_droplets: Sequence[Any]
    value: float


@dataclass(frozen=True, eq=False)
class LinearStep:
    """Droplets of each layer that are best for the linearised map; surface: the last one by that map [um].

    promised: objective of that surface as the linear program has it [um]; linear: with its true deviation [um].
    """

    droplets: Sequence[Cells]
    surface: Cells
    promised: float
    linear: float


class LinearProgram:
    """The linear program of a step from a point, for all problems of the shape of `like`.

    Its variables are the droplets of each layer, the surface after each step, what each cell lacks or has too much,
    what it has above the ceiling, and for the deviation the mean of the part's cells, what each is off it, and its
    square. Surfaces as variables keep it sparse. With d, the deviation at the point, sqrt(v) <= (v / d + d) / 2 for
    every variance v, with equality at the point; the square of each cell is held up by `tangents_max` tangents. So the
    deviation, too, is a sum over cells: a gradient of the whole deviation would say nothing of how it bends.
    seconds_max: what one linear program may take.
    """

    def __init__(self, like: HorizonProblem, *, tangents_max: int, seconds_max: float = inf) -> None:
        self._shape, self._cells, self._has_ceiling = like.part.shape, like.part.size, like.ceiling is not None
        self._layers, self._passes, self._steps = like.layers, like.passes, like.layers * like.passes
        self._part = np.flatnonzero(like.part.ravel(order="F"))
        self._tangents_max = tangents_max if like.alpha < 1.0 else 0
        self._map = _derived_map(like)
        self._matrix = self._assembled()
        self._solvers = [self._solver({**method, "time_limit": seconds_max}) for method in METHODS]

    def point(self, numbers: HorizonStatement, droplets: Sequence[Cells]) -> Point:
        """The surfaces, their derivatives and the objective of droplets."""
        H, surfaces, by_surface, by_droplets = np.asarray(numbers.height), [], [], []
        for layer, U in zip(numbers.layers, droplets, strict=True):
            for jetted in layer.jetted:
                after, by_H, by_U = self._map(H, self._as_map(U), layer.h1, layer.h2, layer.h3, jetted)
                H = np.asarray(after)
                surfaces.append(as_cells(H))
                by_surface.append(by_H)
                by_droplets.append(by_U)
        return Point(droplets, surfaces, by_surface, by_droplets, surface_cost(numbers, H))

    def off_mean(self, surface: Cells) -> Cells:
        """Deviations of the part's cells of a surface from their mean [um]: where tangents touch."""
        return np.asarray(surface[self._part] - surface[self._part].mean(), np.float64)

    def step(
        self, numbers: HorizonStatement, around: Point, radius: float, touching: Sequence[Cells]
    ) -> LinearStep | None:
        """The best droplets within `radius` of a point, by its linearised map; None if HiGHS has found none.

        touching: where the squares have their tangents, each as by `off_mean`; the last `tangents_max` count.
        """
        kept = np.zeros((self._tangents_max, self._part.size))  # a tangent at 0 always holds
        for place, off in enumerate(touching[-self._tangents_max :] if self._tangents_max else ()):
            kept[place] = off
        deviation = max(LEAST_DEVIATION_UM, float(np.sqrt(np.mean(self.off_mean(around.surfaces[-1]) ** 2))))
        lower, upper, limits = self._bounds(numbers, around, radius)
        least, most = self._sides(numbers, around, kept)
        cells = self._part.size  # costs of a whole cell are of the size that HiGHS's tolerances are made for
        given = {
            "a": self._matrix(*around.by_surface, *around.by_droplets, numbers.overshoot, kept.T),
            "g": cells * self._costs(numbers, deviation),
            "lbx": lower,
            "ubx": upper,
            "lba": least,
            "uba": most,
        }
        for solver in self._solvers:
            found = solver(**given)
            if solver.stats()["success"]:
                break
        else:
            return None
        x, last = np.asarray(found["x"]).ravel(), (self._layers + self._steps - 1) * self._cells
        droplets = np.split(np.clip(x[: len(limits)], 0.0, limits), self._layers)
        surface = x[last : last + self._cells]
        promised = float(found["cost"]) / cells + (1.0 - numbers.alpha) * deviation / 2.0
        return LinearStep(droplets, surface, promised, surface_cost(numbers, self._as_map(surface)))

    def _solver(self, options: dict[str, Any]) -> Any:
        sparsity = {"a": self._matrix.sparsity_out(0)}
        options = {"error_on_fail": False, "highs": {"output_flag": False, **options}}
        return ca.conic("step", "highs", sparsity, options)

    def _costs(self, numbers: HorizonStatement, deviation: float) -> Cells:
        weight, inside = as_cells(numbers.weight) * numbers.alpha / self._part.size, self._part.size
        costs = [np.zeros((self._layers + self._steps) * self._cells), weight]
        if self._has_ceiling:
            costs.append(numbers.ceiling_cost * weight)
        if self._tangents_max:
            costs += [np.zeros(1 + inside), np.full(inside, (1.0 - numbers.alpha) / (2.0 * deviation * inside))]
        return np.concatenate(costs)

    def _bounds(self, numbers: HorizonStatement, around: Point, radius: float) -> tuple[Cells, Cells, Cells]:
        """Of all variables, and the largest droplet that may fall on each cell of each layer."""
        limits = np.concatenate([as_cells(layer.limit) for layer in numbers.layers])
        centre = np.concatenate(around.droplets)
        lower, upper = np.full(self._matrix.size2_out(0), -inf), np.full(self._matrix.size2_out(0), inf)
        lower[: len(centre)], upper[: len(centre)] = (
            np.maximum(0.0, centre - radius),
            np.minimum(limits, centre + radius),
        )
        errors = (self._layers + self._steps) * self._cells
        lower[errors : errors + (1 + self._has_ceiling) * self._cells] = 0.0
        if self._tangents_max:
            lower[-self._part.size :] = 0.0
        return lower, upper, limits

    def _assembled(self) -> Any:
        """The matrix, of derivatives, overshoot and places of tangents; its rows are those of `_sides`."""
        one, steps, inside = ca.MX(ca.DM.eye(self._cells)), range(self._steps), self._part.size
        by_surface = [ca.MX.sym("by_surface", self._map.sparsity_out(1)) for _ in steps]
        by_droplets = [ca.MX.sym("by_droplets", self._map.sparsity_out(2)) for _ in steps]
        overshoot, touching = ca.MX.sym("overshoot"), ca.MX.sym("touching", inside, self._tangents_max)
        last = self._layers + self._steps - 1  # column of the last surface
        widths = [self._cells] * (last + 2 + self._has_ceiling)
        rows: list[Mapping[int, Any]] = []
        for step in steps:
            before = {self._layers + step - 1: -by_surface[step]} if step else {}
            rows.append({step // self._passes: -by_droplets[step], self._layers + step: one, **before})
        rows += [{last: one, last + 1: one}, {last: -overshoot * one, last + 1: one}]
        if self._has_ceiling:
            rows.append({last: -one, last + 2: one})
        if self._tangents_max:
            mean, off, square = (len(widths) + k for k in range(3))
            widths += [1, inside, inside]
            chosen = ca.DM(ca.Sparsity.triplet(inside, self._cells, list(range(inside)), self._part.tolist()), 1.0)
            own = ca.MX(ca.DM.eye(inside))
            rows.append({last: ca.MX(chosen), mean: -ca.MX(ca.DM.ones(inside, 1)), off: -own})
            rows += [{off: -2 * ca.diag(touching[:, k]), square: own} for k in range(self._tangents_max)]
        matrix = ca.vertcat(*(_row(blocks, widths) for blocks in rows))
        return ca.Function("matrix", [*by_surface, *by_droplets, overshoot, touching], [matrix])

    def _sides(self, numbers: HorizonStatement, around: Point, touching: Cells) -> tuple[Cells, Cells]:
        """Bounds of the rows: equations of the steps; errors below, above the target, the ceiling; what cells
        are off their mean, which are equations, and the tangents.
        """
        steps = []
        for step in range(self._steps):
            right = (
                around.surfaces[step]
                - np.asarray(around.by_droplets[step] @ around.droplets[step // self._passes]).ravel()
            )
            if step:
                right -= np.asarray(around.by_surface[step] @ around.surfaces[step - 1]).ravel()
            steps.append(right)
        target = as_cells(numbers.target)
        errors = [target, -numbers.overshoot * target, *([-as_cells(numbers.ceiling)] if self._has_ceiling else [])]
        off = [np.zeros(self._part.size)] if self._tangents_max else []
        least = [*steps, *errors, *off, -(touching**2).ravel()]
        free = [np.full(len(side), inf) for side in errors]
        return np.concatenate(least), np.concatenate([*steps, *free, *off, np.full(touching.size, inf)])

    def _as_map(self, cells: Cells) -> NDArray[np.float64]:
        return np.reshape(cells, self._shape, order="F")


def as_cells(M: Any) -> Cells:
    """A map (nx, ny) as one column."""
    return np.asarray(M, np.float64).ravel(order="F")


def _derived_map(like: HorizonProblem) -> Any:
    """The surface after one step, with its derivatives by the surface before and by the droplets of the layer."""
    H, U, h1, h2, h3, jetted = (ca.SX.sym(name, *like.part.shape) for name in ("H", "U", "h1", "h2", "h3", "jetted"))
    after = jet(H, LayerSymbols(h1, h2, h3, 1, (jetted,)), jetted * U)
    derivatives = [ca.jacobian(ca.vec(after), ca.vec(by)) for by in (H, U)]
    return ca.Function("map", [H, U, h1, h2, h3, jetted], [after, *derivatives])


def _row(blocks: Mapping[int, Any], widths: Sequence[int]) -> Any:
    """A row of blocks, empty where there is none."""
    height = next(iter(blocks.values())).shape[0]
    return ca.horzcat(*(blocks.get(place, ca.MX(height, width)) for place, width in enumerate(widths)))

"""The layer-to-layer map and the layer problem as they are written on paper, over CasADi symbols or numbers alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import casadi as ca
import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.contract import pass_colour
from inkloop.units import M_PER_UM
from inkloop_controller.problem.horizon_problem import HorizonProblem

Symbolic: TypeAlias = Any
"""A CasADi matrix (MX, SX or DM), or a number where one will do."""

SIDES = ((-1, 0), (0, -1), (0, 1), (1, 0))
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))
PositivePart: TypeAlias = Callable[[Symbolic], Symbolic]
"""max(x, 0) of every entry, in the form that a solver wants."""
Deviation: TypeAlias = Callable[[Symbolic], Symbolic]
"""Population standard deviation of a column, in the form that a solver wants."""


@dataclass(frozen=True)
class LayerSymbols:
    """Variables of one layer of the horizon: (nx, ny) each, heights in um.

    h1, h2, h3: what the smallest droplet allowed on a cell adds; limit: the largest one allowed, counted in those;
    jetted: for each pass, 1 on the cells that it jets on.
    """

    h1: Symbolic
    h2: Symbolic
    h3: Symbolic
    limit: Symbolic
    jetted: tuple[Symbolic, ...]


@dataclass(frozen=True, eq=False)
class HorizonStatement:
    """The values of a HorizonProblem, as symbols or numbers, heights in um from the part's mean before the first layer.

    ceiling: None where the problem has none.
    """

    part: BoolMap
    height: Symbolic
    target: Symbolic
    ceiling: Symbolic | None
    weight: Symbolic
    alpha: Symbolic
    overshoot: Symbolic
    ceiling_cost: Symbolic
    layers: tuple[LayerSymbols, ...]

    def steps(self, droplets: list[Symbolic]) -> Iterator[tuple[LayerSymbols, Symbolic]]:
        """Layer and droplets (nx, ny) of every pass of the horizon, in the order jetted."""
        for layer, U in zip(self.layers, droplets, strict=True):
            for jetted in layer.jetted:
                yield layer, jetted * U

    def error(self, H: Symbolic, positive_part: PositivePart) -> Symbolic:
        """Cost of each cell of the last surface H (nx, ny) [um], before its weight."""
        error = positive_part(self.target - H) + self.overshoot * positive_part(H - self.target)
        return error if self.ceiling is None else error + self.ceiling_cost * positive_part(H - self.ceiling)

    def cost(self, H: Symbolic, positive_part: PositivePart, deviation: Deviation) -> Symbolic:
        """alpha (error + over_ceiling) + (1 - alpha) deviation of the last surface H (nx, ny) [um]."""
        error = ca.dot(ca.vec(self.weight), ca.vec(self.error(H, positive_part))) / int(self.part.sum())
        return self.alpha * error + (1.0 - self.alpha) * deviation(over(self.part, H))

    def values(self) -> Iterator[Symbolic]:
        """Every symbol or number, in a fixed order."""
        yield from (self.height, self.target, self.weight, self.alpha, self.overshoot, self.ceiling_cost)
        if self.ceiling is not None:
            yield self.ceiling
        for layer in self.layers:
            yield from (layer.h1, layer.h2, layer.h3, layer.limit, *layer.jetted)


def last_surface(statement: HorizonStatement, droplets: list[Symbolic]) -> Symbolic:
    """Surface (nx, ny) [um] after the last pass, for droplets (nx, ny) of each layer."""
    H: Symbolic = ca.DM(statement.height)
    for layer, jetted in statement.steps(droplets):
        H = jet(H, layer, jetted)
    return H


def jet(H: Symbolic, layer: LayerSymbols, U: Symbolic) -> Symbolic:
    """Surface (nx, ny) [um] after one pass with the droplets U (nx, ny) over H."""
    return symbolic_layer(H, U, layer.h1, layer.h2, layer.h3)


def numbers_of(problem: HorizonProblem) -> HorizonStatement:
    """The statement with the numbers of a problem."""
    reference = float(problem.height[problem.part].mean())  # only differences of heights count
    ceiling = None if problem.ceiling is None else (problem.ceiling - reference) / M_PER_UM
    return HorizonStatement(
        problem.part,
        (problem.height - reference) / M_PER_UM,
        (problem.target - reference) / M_PER_UM,
        ceiling,
        problem.weights,
        problem.alpha,
        problem.overshoot,
        problem.ceiling_cost,
        tuple(_layer_numbers(problem, layer) for layer in range(problem.layers)),
    )


def exact_cost(statement: HorizonStatement, droplets: list[Any]) -> float:
    """Objective [um] of droplets (nx, ny) of each layer, for a statement in numbers."""
    return surface_cost(statement, last_surface(statement, droplets))


def surface_cost(statement: HorizonStatement, H: Symbolic) -> float:
    """Objective [um] of the last surface H (nx, ny) [um], for a statement in numbers."""
    return float(statement.cost(H, lambda x: ca.fmax(x, 0), lambda cells: ca.sqrt(variance(cells))))


def variance(cells: Symbolic) -> Symbolic:
    """Population variance of a column."""
    return ca.sumsqr(cells - ca.sum1(cells) / cells.numel()) / cells.numel()


def over(part: BoolMap, M: Symbolic) -> Symbolic:
    """The part's cells of a map, as a column."""
    column: Any = ca.vec(M)
    return column[np.flatnonzero(part.ravel(order="F")).tolist()]


def first_kinds(problem: HorizonProblem) -> Any:
    """(layers, nx, ny) the first kind that may fall on a cell; 0 where none may."""
    bits = problem.choices[..., None] >> np.arange(len(problem.kinds)) & 1
    return np.argmax(bits, axis=-1)


def drop_limits(problem: HorizonProblem) -> FloatMap:
    """(layers, nx, ny) the largest droplet that may fall on a cell, counted in whole droplets of the first kind."""
    heights = np.array([kind.layer_height for kind in problem.kinds])
    levels = np.round(heights / heights[first_kinds(problem)][..., None])
    allowed = problem.choices[..., None] >> np.arange(len(problem.kinds)) & 1
    return np.asarray((levels * allowed).max(axis=-1), np.float64)


def _layer_numbers(problem: HorizonProblem, layer: int) -> LayerSymbols:
    table = np.array([[kind.h1, kind.h2, kind.h3] for kind in problem.kinds]) / M_PER_UM
    h1, h2, h3 = np.moveaxis(table[first_kinds(problem)[layer]], -1, 0)
    return LayerSymbols(h1, h2, h3, drop_limits(problem)[layer], jetted_maps(problem)[layer])


def jetted_maps(problem: HorizonProblem) -> tuple[tuple[FloatMap, ...], ...]:
    """For each pass of each layer, 1 on the cells that it jets on (nx, ny)."""
    i, j = np.indices(problem.part.shape)
    if not problem.colours:
        return ((np.ones(problem.part.shape),),) * problem.layers
    colour = pass_colour(i, j)
    return tuple(tuple((colour == each).astype(np.float64) for each in order) for order in problem.colours)


def symbolic_layer(H: Symbolic, U: Symbolic, h1: Symbolic, h2: Symbolic, h3: Symbolic) -> Symbolic:
    """Surface after one pass over the surface H (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    H: (nx, ny) heights; U: (nx, ny) droplets, relaxed to 0..1; h1, h2, h3: the ink of each cell's droplet in the unit
    of H, numbers or (nx, ny). Linear in U; clipped, hence not smooth, in H.
    """
    kept, given = symbolic_shares(H, U, h1, h2, h3)
    return H + kept + given


def symbolic_shares(H: Symbolic, U: Symbolic, h1: Symbolic, h2: Symbolic, h3: Symbolic) -> tuple[Symbolic, Symbolic]:
    """Height that droplets of symbolic_layer leave on their own cells, and that cells get from their neighbours'."""
    kept, given = h1 * U, ca.DM.zeros(H.shape)
    for neighbours, spread in ((SIDES, h2), (CORNERS, h3)):
        for di, dj in neighbours:
            inside = _shifted(ca.DM.ones(H.shape), di, dj)
            rise = inside * (H - _shifted(H, di, dj))
            taken = spread * ca.fmax(0, ca.fmin(1, 1 + rise / (h1 + spread)))
            kept += (spread - taken) * U
            given += _shifted(taken * U, -di, -dj)
    return kept, given


def _shifted(M: Symbolic, di: int, dj: int) -> Symbolic:
    """Cell (i, j) of the result is cell (i + di, j + dj) of M, zero where that lies outside."""
    nx, ny = M.shape
    rows = ca.DM.zeros(1, ny)
    if di:
        M = ca.vertcat(M[1:, :], rows) if di > 0 else ca.vertcat(rows, M[:-1, :])
    columns = ca.DM.zeros(nx, 1)
    if dj:
        M = ca.horzcat(M[:, 1:], columns) if dj > 0 else ca.horzcat(columns, M[:, :-1])
    return M

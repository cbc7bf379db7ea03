"""The layer problem as a mixed-integer program with names, to be written into a file.

Heights in um from the part's mean before the first layer, as in statement.py. Layers, kinds, steps and cells are
counted from 1, 1, 1 and 0; a step is a layer, or one of its four passes.

    u_LAYER_KIND_I_J     whole: 1 where a droplet of the kind falls on cell (i, j), for those that are allowed there
    h_STEP_I_J           surface after the step, where droplets can change it [um]
    below_I_J, above_I_J what the last surface lacks to the target, and what it has too much [um]; with droplet_std = 0
    cost_I_J             the two as they are to be expected, and `overshoot` times the second [um]; with droplet_std > 0
    chance_I_J           what the last droplet leaves to chance, +- [um]; with droplet_std > 0
    over_I_J             what is above the ceiling [um]
    mean, deviation      of the part's cells in the last surface [um]; with alpha < 1

The objective is linear, that of HorizonProblem in um: alpha / cells of the part times the weighted sum of below,
`overshoot` times above, or cost, and ceiling_cost times over, and 1 - alpha times deviation.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, sqrt
from typing import Any

import casadi as ca
import numpy as np

from inkloop.units import M_PER_UM
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.layer_function import expected_size, jet_kinds
from inkloop_controller.program.statement import HorizonStatement, jetted_maps, numbers_of


@dataclass(eq=False)
class MixedProgram:
    """minimise costs' x with lower <= x <= upper, rows_lower <= rows(x) <= rows_upper, x[k] whole where is_whole[k]."""

    names: list[str] = field(default_factory=list)
    x: list[Any] = field(default_factory=list)
    lower: list[float] = field(default_factory=list)
    upper: list[float] = field(default_factory=list)
    is_whole: list[bool] = field(default_factory=list)
    costs: list[float] = field(default_factory=list)
    row_names: list[str] = field(default_factory=list)
    rows: list[Any] = field(default_factory=list)
    rows_lower: list[float] = field(default_factory=list)
    rows_upper: list[float] = field(default_factory=list)

    def variable(self, name: str, lower: float, upper: float, cost: float = 0.0, *, is_whole: bool = False) -> Any:
        """A new variable, a symbol."""
        symbol = ca.SX.sym(name)
        self.names.append(name)
        self.x.append(symbol)
        self.lower.append(lower)
        self.upper.append(upper)
        self.is_whole.append(is_whole)
        self.costs.append(cost)
        return symbol

    def row(self, name: str, expression: Any, lower: float, upper: float) -> None:
        """A new row, an expression of the variables."""
        self.row_names.append(name)
        self.rows.append(expression)
        self.rows_lower.append(lower)
        self.rows_upper.append(upper)

    def equation(self, name: str, left: Any, right: Any) -> None:
        """left = right"""
        self.row(name, left - right, 0.0, 0.0)

    def least(self, name: str, of: Any, at_least: Any) -> None:
        """of >= at_least"""
        self.row(name, of - at_least, 0.0, inf)


def mixed_program(problem: HorizonProblem) -> MixedProgram:
    """The program of a problem."""
    program, numbers = MixedProgram(), numbers_of(problem)
    inks = [[h / M_PER_UM for h in (kind.h1, kind.h2, kind.h3)] for kind in problem.kinds]
    H, kept, step = ca.SX(ca.DM(numbers.height)), ca.SX.zeros(problem.part.shape), 0
    for layer, passes in enumerate(jetted_maps(problem)):
        droplets = _droplets(program, problem, layer)
        for jetted in passes:
            step += 1
            after, kept = jet_kinds(H, [ca.DM(jetted) * U for U in droplets], inks)
            H = _surface(program, after, step)
    chance = None if problem.droplet_std == 0.0 else _chance(program, problem, kept, min(ink[0] for ink in inks))
    _errors(program, problem, numbers, H, chance)
    if problem.alpha < 1.0:
        _deviation(program, problem, H, chance)
    return program


def _droplets(program: MixedProgram, problem: HorizonProblem, layer: int) -> list[Any]:
    """For each kind, 1 where such a droplet falls; at most one on each cell."""
    maps = [ca.SX(*problem.part.shape) for _ in problem.kinds]
    for i, j in _cells(problem):
        allowed = [kind for kind in range(len(maps)) if problem.choices[layer, i, j] >> kind & 1]
        for kind in allowed:
            name = f"u_{layer + 1}_{kind + 1}_{i}_{j}"
            maps[kind][i, j] = program.variable(name, 0.0, 1.0, is_whole=True)
        if len(allowed) > 1:
            program.row(f"one_{layer + 1}_{i}_{j}", sum(maps[kind][i, j] for kind in allowed), -inf, 1.0)
    return maps


def _surface(program: MixedProgram, after: Any, step: int) -> Any:
    """A variable for every cell that droplets can change."""
    H = ca.SX(ca.DM.zeros(after.shape))
    for i in range(after.shape[0]):
        for j in range(after.shape[1]):
            height = after[i, j]
            if height.is_constant():
                H[i, j] = height
                continue
            H[i, j] = program.variable(f"h_{step}_{i}_{j}", -inf, inf)
            program.equation(f"step_{step}_{i}_{j}", H[i, j], height)
    return H


def _chance(program: MixedProgram, problem: HorizonProblem, kept: Any, smallest: float) -> Any:
    """Scatter by each cell's last droplet: of its own one, or of one on level ground if that is more."""
    share = sqrt(3.0) * problem.droplet_std
    chance = ca.SX(ca.DM.ones(kept.shape) * share * smallest)
    for i, j in _cells(problem):
        if not kept[i, j].is_constant():
            chance[i, j] = program.variable(f"chance_{i}_{j}", share * smallest, inf)
            program.equation(f"left_{i}_{j}", chance[i, j], share * ca.fmax(smallest, kept[i, j]))
    return chance


def _errors(
    program: MixedProgram, problem: HorizonProblem, numbers: HorizonStatement, H: Any, chance: Any | None
) -> None:
    upward, skew = (problem.overshoot + 1) / 2, (problem.overshoot - 1) / 2
    for i, j in _cells(problem):
        share = problem.alpha * float(problem.weights[i, j]) / int(problem.part.sum())
        if share == 0.0:
            continue
        error, place = H[i, j] - numbers.target[i, j], f"{i}_{j}"
        if chance is None:
            program.least(f"low_{place}", program.variable(f"below_{place}", 0.0, inf, share), -error)
            above = program.variable(f"above_{place}", 0.0, inf, share * problem.overshoot)
            program.least(f"high_{place}", above, error)
        else:
            expected = upward * expected_size(error, chance[i, j]) + skew * error
            program.least(f"error_{place}", program.variable(f"cost_{place}", 0.0, inf, share), expected)
        if numbers.ceiling is not None and problem.ceiling_cost > 0.0:
            over = program.variable(f"over_{place}", 0.0, inf, share * problem.ceiling_cost)
            program.least(f"ceiling_{place}", over, H[i, j] - numbers.ceiling[i, j])


def _deviation(program: MixedProgram, problem: HorizonProblem, H: Any, chance: Any | None) -> None:
    """A cone: the norm of what the part's cells differ by from their mean, and of what is left to chance."""
    cells = [(i, j) for i, j in _cells(problem) if problem.part[i, j]]
    mean = program.variable("mean", -inf, inf)
    deviation = program.variable("deviation", 0.0, inf, 1.0 - problem.alpha)
    program.equation("mean_of_part", len(cells) * mean, sum(H[cell] for cell in cells))
    squares = sum((H[cell] - mean) ** 2 for cell in cells)
    if chance is not None:
        squares += sum(chance[cell] ** 2 for cell in cells) / 3.0
    program.least("deviation_of_part", deviation**2, squares / len(cells))


def _cells(problem: HorizonProblem) -> Iterator[tuple[int, int]]:
    yield from ((int(i), int(j)) for i, j in np.ndindex(*problem.part.shape))

"""The layer problem in files that other solvers read; mixed_program names its variables.

.mps is MPS in its free form, which HiGHS, CPLEX, Gurobi, SCIP and CBC read; .nl the text form of AMPL's format
(D. M. Gay, Writing .nl Files, 2005), which Bonmin, Couenne, SCIP, Knitro and CasADi's NlpBuilder read. A .nl file holds
no names: they stand in a .row and a .col file next to it, one a line. Minima and maxima are written in it with absolute
values, which more readers know; nonlinear rows come before linear ones, and variables in the order nonlinear, then
linear, whole ones behind the others.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isinf
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from inkloop.files import write_text
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.mixed_program import MixedProgram, mixed_program


def write_program(problem: HorizonProblem, path: Path) -> None:
    """Write a problem as a mixed-integer program; raises ValueError where the format of `path` does not hold it."""
    if path.suffix == ".nl":
        found = nl_text(mixed_program(problem))
        write_text(path, found.text)
        for suffix, names in ((".row", found.row_names), (".col", found.names)):
            write_text(path.with_suffix(suffix), "".join(f"{name}\n" for name in names))
    elif path.suffix != ".mps":
        raise ValueError(f"{path} ends in {path.suffix!r}; needs .mps (a linear problem) or .nl (any)")
    elif errors := _not_linear(problem):
        raise ValueError(
            f"{path}: a problem with {', '.join(errors)} is not linear, and .mps holds linear ones only; write a .nl "
            "file, or set horizon = 1, alpha = 1, droplet_std = 0 and passes = 1"
        )
    else:
        write_text(path, "".join(f"{line}\n" for line in _mps_lines(mixed_program(problem))))


def _not_linear(problem: HorizonProblem) -> list[str]:
    """Causes of a nonlinear problem."""
    return [
        *([f"{problem.layers} layers"] if problem.layers > 1 else []),
        *([f"{problem.passes} passes"] if problem.passes > 1 else []),
        *([f"alpha = {problem.alpha}"] if problem.alpha < 1.0 else []),
        *([f"droplet_std = {problem.droplet_std}"] if problem.droplet_std > 0.0 else []),
    ]


def _mps_lines(program: MixedProgram) -> Iterator[str]:
    x = ca.vertcat(*program.x)
    rows = ca.vertcat(ca.SX(0, 1), *program.rows)
    constants, slopes = ca.Function("rows", [x], [rows, ca.jacobian(rows, x)])(0.0)
    first, row_of, values = slopes.sparsity().colind(), slopes.sparsity().row(), slopes.nonzeros()
    yield "NAME layer_problem"
    yield "ROWS"
    yield " N objective"
    for name, lower, upper in zip(program.row_names, program.rows_lower, program.rows_upper, strict=True):
        yield f" {'E' if lower == upper else 'L' if isinf(lower) else 'G'} {name}"
    yield "COLUMNS"
    was_whole = False
    for k, (name, is_whole) in enumerate(zip(program.names, program.is_whole, strict=True)):
        if is_whole != was_whole:
            yield f" marker_{k} 'MARKER' '{'INTORG' if is_whole else 'INTEND'}'"
        was_whole = is_whole
        yield f" {name} objective {program.costs[k]!r}"
        for place in range(first[k], first[k + 1]):
            yield f" {name} {program.row_names[row_of[place]]} {float(values[place])!r}"
    if was_whole:
        yield " marker_end 'MARKER' 'INTEND'"
    yield "RHS"
    sides = np.where(np.isinf(program.rows_lower), program.rows_upper, program.rows_lower)
    for name, side, constant in zip(program.row_names, sides, np.asarray(constants).ravel(), strict=True):
        yield f" right {name} {float(side - constant)!r}"
    yield "BOUNDS"
    for name, lower, upper in zip(program.names, program.lower, program.upper, strict=True):
        if isinf(lower):
            yield f" FR bound {name}"
        else:
            yield f" LO bound {name} {lower!r}"
            if not isinf(upper):
                yield f" UP bound {name} {upper!r}"
    yield "ENDATA"


_OPERATORS = {
    ca.OP_ADD: "o0",
    ca.OP_SUB: "o1",
    ca.OP_MUL: "o2",
    ca.OP_DIV: "o3",
    ca.OP_NEG: "o16",
    ca.OP_FABS: "o15",
}
"""Number of an operation in CasADi -> that of its operator in a .nl file (Gay 2005, table 8)."""


@dataclass(frozen=True)
class NlText:
    """The text of the .nl file, and the names of its rows and variables in their order there."""

    text: str
    row_names: Sequence[str]
    names: Sequence[str]


def nl_text(program: MixedProgram) -> NlText:
    """The program as a .nl file."""
    rows, x = ca.vertcat(*program.rows), ca.vertcat(*program.x)
    slopes = ca.jacobian(rows, x)
    places = zip(*slopes.sparsity().get_triplet(), slopes.nonzeros(), strict=True)
    row_slopes: list[dict[int, Any]] = [{} for _ in program.rows]
    for row, column, slope in places:
        row_slopes[row][column] = slope
    is_bent = [not all(slope.is_constant() for slope in found.values()) for found in row_slopes]
    bent = {column for found, nonlinear in zip(row_slopes, is_bent, strict=True) if nonlinear for column in found}
    row_order = sorted(range(len(is_bent)), key=lambda row: not is_bent[row])
    order = sorted(range(len(program.x)), key=lambda k: (k not in bent, program.is_whole[k]))
    place_of = {k: place for place, k in enumerate(order)}
    symbols = {program.x[k].element_hash(): place for k, place in place_of.items()}
    constants = ca.Function("constants", [x], [rows])(0.0)
    lines = list(_header(program, row_slopes, sum(is_bent), bent))
    for place, row in enumerate(row_order):
        lines.append(f"C{place}")
        lines += _expression(program.rows[row], symbols) if is_bent[row] else ["n0"]
    lines += ["O0 0", "n0", "r"]
    for row in row_order:
        constant = 0.0 if is_bent[row] else float(constants[row])
        lines.append(_bounds(program.rows_lower[row] - constant, program.rows_upper[row] - constant))
    lines += ["b", *(_bounds(program.lower[k], program.upper[k]) for k in order)]
    lines += _column_ends(row_slopes, order)
    for place, row in enumerate(row_order):
        terms = {place_of[k]: 0.0 if is_bent[row] else float(slope) for k, slope in row_slopes[row].items()}
        lines += _terms(f"J{place}", terms)
    lines += _terms("G0", {place_of[k]: cost for k, cost in enumerate(program.costs) if cost != 0.0})
    names = [program.names[k] for k in order]
    return NlText("\n".join(lines) + "\n", [program.row_names[row] for row in row_order], names)


def _header(
    program: MixedProgram, row_slopes: Sequence[Mapping[int, Any]], bent_rows: int, bent: set[int]
) -> Iterator[str]:
    """The ten lines of counts."""
    equations = sum(lower == upper for lower, upper in zip(program.rows_lower, program.rows_upper, strict=True))
    whole = {k for k, is_whole in enumerate(program.is_whole) if is_whole}
    yield "g3 1 1 0"
    yield f" {len(program.x)} {len(program.rows)} 1 0 {equations}"
    yield f" {bent_rows} 0"
    yield " 0 0"
    yield f" {len(bent)} 0 0"
    yield " 0 0 0 1"
    yield f" {len(whole - bent)} 0 0 {len(whole & bent)} 0"
    yield f" {sum(map(len, row_slopes))} {sum(cost != 0.0 for cost in program.costs)}"
    yield f" {max(map(len, program.row_names), default=0)} {max(map(len, program.names))}"
    yield " 0 0 0 0 0"


def _expression(expression: Any, symbols: Mapping[int, int]) -> Iterator[str]:
    """An expression as a tree, the operator before what it is of."""
    ahead: list[Any] = [expression]
    while ahead:
        found = ahead.pop()
        if isinstance(found, str):
            yield found
        elif found.is_symbolic():
            yield f"v{symbols[found.element_hash()]}"
        elif found.is_constant():
            yield f"n{float(found)!r}"
        else:
            ahead += reversed(_parts(found))


def _parts(found: Any) -> list[Any]:
    """Operator and operands of the root of an expression; raises KeyError for one that no layer problem has."""
    operation, of = found.op(), [found.dep(k) for k in range(found.n_dep())]
    if (
        operation == ca.OP_FMAX
        and _is_number(of[0], 0.0)
        and of[1].op() == ca.OP_FMIN
        and _is_number(of[1].dep(0), 1.0)
    ):
        x = of[1].dep(1)  # clipped to 0..1: (1 + |x| - |x - 1|) / 2
        return ["o2", "n0.5", "o1", "o0", "n1", "o15", x, "o15", "o1", x, "n1"]
    if operation in (ca.OP_FMIN, ca.OP_FMAX):  # (a + b -+ |a - b|) / 2
        sign = "o1" if operation == ca.OP_FMIN else "o0"
        return ["o2", "n0.5", sign, "o0", *of, "o15", "o1", *of]
    if operation == ca.OP_SQ:
        return ["o5", *of, "n2"]
    if operation == ca.OP_TWICE:
        return ["o2", "n2", *of]
    if operation == ca.OP_INV:
        return ["o3", "n1", *of]
    return [_OPERATORS[operation], *of]


def _is_number(found: Any, value: float) -> bool:
    return bool(found.is_constant()) and float(found) == value


def _bounds(lower: float, upper: float) -> str:
    if lower == upper:
        return f"4 {lower!r}"
    if isinf(lower):
        return "3" if isinf(upper) else f"1 {upper!r}"
    return f"2 {lower!r}" if isinf(upper) else f"0 {lower!r} {upper!r}"


def _column_ends(row_slopes: Sequence[Mapping[int, Any]], order: Sequence[int]) -> Iterator[str]:
    """Numbers of entries of the rows in the columns so far, for all columns but the last."""
    counts = [0] * len(order)
    for found in row_slopes:
        for k in found:
            counts[k] += 1
    yield f"k{len(order) - 1}"
    total = 0
    for k in order[:-1]:
        total += counts[k]
        yield f"{total}"


def _terms(head: str, terms: Mapping[int, float]) -> Iterable[str]:
    return [f"{head} {len(terms)}", *(f"{place} {terms[place]!r}" for place in sorted(terms))] if terms else []

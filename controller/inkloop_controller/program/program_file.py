"""The layer problem in files that other solvers read; mixed_program names its variables.

.mps is MPS in its free form, which HiGHS, CPLEX, Gurobi, SCIP and CBC read; .nl the text form of AMPL's format, which
Bonmin, Couenne, SCIP, Knitro and CasADi's NlpBuilder read. A .nl file holds no names: they stand in a .row and a .col
file next to it, one a line.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isinf
from pathlib import Path

import casadi as ca
import numpy as np

from inkloop.files import write_text
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.program.mixed_program import MixedProgram, mixed_program
from inkloop_controller.program.nl_text import nl_text


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

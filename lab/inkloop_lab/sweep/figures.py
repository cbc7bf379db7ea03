"""The figures of a print that studies compare, their units, and expressions of them."""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from inkloop.errors import nearest
from inkloop.results.attributes import Meaning
from inkloop.results.metrics import MEAN_ERROR, SIGN
from inkloop.units import UM_PER_M

_OVER = "over the part, at the end of a print"
METRICS: Mapping[str, tuple[str, Meaning]] = {
    "mean_error": ("m", Meaning(f"mean error {_OVER} ({SIGN})")),
    "mae": ("m", Meaning(f"mean absolute error {_OVER}")),
    "rms": ("m", Meaning(f"root mean square error {_OVER}")),
    "std": ("m", Meaning(f"standard deviation of the error {_OVER}")),
    "min": ("m", Meaning(f"smallest error {_OVER}: of the cell that stands highest above its target")),
    "max": ("m", Meaning(f"largest error {_OVER}: of the cell that lies lowest below its target")),
    "layers": ("1", Meaning("printed layers")),
    "droplets": ("1", Meaning("droplets that landed")),
    "mismatch": ("1", Meaning("volume of ink A that is misplaced or missing, as a share of the volume wanted")),
}
"""Metric of `Result.metrics` -> unit and meaning; the last one of parts in two inks only."""


def label(metric: str) -> str:
    """The name of a metric with the unit that people read it in."""
    return f"{metric}_um" if METRICS[metric][0] == "m" else metric


def heading(metric: str) -> str:
    """The name of the mean of a metric over prints, see `without_sign`."""
    return f"|{metric}|" if metric == MEAN_ERROR else metric


VARIABLES: Mapping[str, str] = {label(name): name for name in METRICS}
"""Name in an expression, with its unit -> metric."""

FUNCTIONS: Mapping[str, Callable[..., float]] = {
    **{"abs": abs, "min": min, "max": max, "sqrt": math.sqrt, "exp": math.exp, "log": math.log},
}
_OPERATORS: Mapping[type[ast.AST], Callable[..., float]] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv},
    **{ast.Pow: operator.pow, ast.USub: operator.neg, ast.UAdd: operator.pos},
}
Value: TypeAlias = Callable[[Mapping[str, float]], float]
LENGTH_MAX = 500
"""Characters of an expression; more is no objective but a program (assumed)."""


def scaled(metric: str, value: float) -> float:
    """The value of a metric as people read it: lengths in micrometres."""
    return value * UM_PER_M if METRICS[metric][0] == "m" else value


@dataclass(frozen=True)
class Expression:
    """Arithmetic of metrics, such as "mae_um + 0.001 * layers"; nothing else can be written in it.

    Lengths carry their unit in the name. Raises ValueError with the part that is no arithmetic.
    """

    text: str

    def __post_init__(self) -> None:
        _compiled(self._tree())

    def __call__(self, metrics: Mapping[str, float]) -> float:
        """The value for the metrics of a print [m]; NaN where it has none: a root of a negative number, n / 0."""
        values = {name: scaled(metric, metrics[metric]) for name, metric in VARIABLES.items() if metric in metrics}
        try:
            found = _compiled(self._tree())(values)
        except (ArithmeticError, ValueError, KeyError):
            return math.nan
        return found if isinstance(found, float) else math.nan  # a power of a negative number is complex

    def _tree(self) -> ast.expr:
        if len(self.text) > LENGTH_MAX:
            raise ValueError(f"has {len(self.text)} characters; at most {LENGTH_MAX}")
        try:
            return ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise ValueError(f"is no expression ({error.args[0]}); expected such as mae_um + 0.001 * layers") from error


def _compiled(node: ast.AST) -> Value:
    """The value of a node by those of the metrics. Raises ValueError for anything but numbers, metrics, arithmetic and
    the functions above.
    """
    match node:
        case ast.BinOp(left, operation, right) if type(operation) in _OPERATORS:
            return _applied(_OPERATORS[type(operation)], [left, right])
        case ast.UnaryOp(operation, operand) if type(operation) in _OPERATORS:
            return _applied(_OPERATORS[type(operation)], [operand])
        case ast.Call(ast.Name(name), arguments, []) if name in FUNCTIONS and arguments:
            return _applied(FUNCTIONS[name], arguments)
        case ast.Constant(value) if isinstance(value, int | float) and not isinstance(value, bool):
            return lambda _: float(value)
        case ast.Name(name) if name in VARIABLES:
            return lambda values: values[name]
        case ast.Name(name):
            unit = f"; write {name}_um" if name in METRICS else f"; {nearest(name, VARIABLES)}"
            raise ValueError(f"has {name}, which is no metric with its unit{unit}")
    raise ValueError(f"has {ast.unparse(node)!r}; expected + - * / **, brackets and {', '.join(FUNCTIONS)}")


def _applied(operation: Callable[..., float], nodes: Sequence[ast.AST]) -> Value:
    operands = [_compiled(node) for node in nodes]
    return lambda values: operation(*(operand(values) for operand in operands))

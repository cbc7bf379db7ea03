"""Dataclasses with arrays are equal to themselves only: an array has no truth value, so == of fields would raise."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterator
from functools import cache

from inkloop.component import Port
from support.source_tree import modules, parsed

ARRAYS = {"NDArray", "ndarray", "Dataset"}


def trees() -> list[ast.Module]:
    """The modules of the product."""
    return [parsed(path) for path in modules().values()]


def names_in(tree: ast.AST) -> set[str]:
    """Names and attributes below a node."""
    names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}
    return names | {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}


@cache
def array_types() -> set[str]:
    """Names of array types: NumPy's and xarray's, and the aliases that the packages define from them."""
    aliases = {
        node.target.id: names_in(node.value)
        for tree in trees()
        for node in tree.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and node.value is not None
        if names_in(node.annotation) == {"TypeAlias"} and "Callable" not in names_in(node.value)
    }
    found = set(ARRAYS)
    while added := {name for name, parts in aliases.items() if parts & found} - found:
        found |= added
    return found


def dataclasses_with_arrays() -> Iterator[tuple[str, list[str]]]:
    """Class name and decorators of each dataclass with an array in a field."""
    types = array_types()
    for tree in trees():
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                fields = [statement.annotation for statement in node.body if isinstance(statement, ast.AnnAssign)]
                decorators = [ast.unparse(decorator) for decorator in node.decorator_list]
                if any(names_in(field) & types for field in fields):
                    yield node.name, [decorator for decorator in decorators if decorator.startswith("dataclass")]


def test_array_types_include_the_aliases_of_the_packages() -> None:
    assert {"FloatMap", "BoolMap", "IntPlan", "ChoiceMaps"} <= array_types()


def test_dataclass_with_arrays_is_compared_by_identity() -> None:
    found = [(name, decorators) for name, decorators in dataclasses_with_arrays() if decorators]
    assert len(found) > 30
    assert not [name for name, (decorator,) in found if "eq=False" not in decorator]


def test_ports_that_start_as_nan_are_equal() -> None:
    one, other = (Port("growth", "m", start=start) for start in (math.nan, float("nan")))
    assert one == other
    assert hash(one) == hash(other)
    assert one != Port("growth", "m")

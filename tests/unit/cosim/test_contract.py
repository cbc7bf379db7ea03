"""The layer contract stands in one place: its signals, its page, the colours and orders of the passes."""

from __future__ import annotations

import ast
import re
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from inkloop.component import Port
from inkloop.contract import (
    COUNTERS,
    LAYER_COMMAND,
    SIGNALS,
    PassOrder,
    Signal,
    checked_command,
    contract_ports,
    pass_colour,
    pass_colours,
)
from inkloop.course.layer_course import contract_connections
from inkloop.errors import ComponentError
from inkloop.tables import schema
from inkloop.testing import job
from inkloop_controller.baseline_planners import OpenLoop
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.layer_controller import LayerController
from support.places import ROOT
from support.source_tree import modules, parsed

OWN = Path("cosim/inkloop/contract.py")
WORDS = {"pattern", "height", "valid", "status", "stop_reason"}  # of other things, too
DISTINCT = sorted(SIGNALS.keys() - WORDS)
TYPES = {"int32": "integer", "float64": "real", "bool": "boolean"}
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| (.+) \|$", re.MULTILINE)


@cache
def nodes() -> dict[Path, list[ast.AST]]:
    """Constants, products and tuples of the modules of the product."""
    kinds = (ast.Constant, ast.BinOp, ast.Tuple)
    return {
        path.relative_to(ROOT): [node for node in ast.walk(parsed(path)) if isinstance(node, kinds)]
        for path in modules().values()
    }


def modules_with(fits: Callable[[ast.AST], bool]) -> set[Path]:
    return {path for path, found in nodes().items() if any(map(fits, found))}


def is_twice_a_remainder(node: ast.AST) -> bool:
    """2 * (i % 2), the beginning of the formula of the colours."""
    match node:
        case ast.BinOp(ast.Constant(2), ast.Mult(), ast.BinOp(_, ast.Mod(), ast.Constant(2))):
            return True
    return False


def is_tuple(node: ast.AST, numbers: tuple[int, ...]) -> bool:
    return isinstance(node, ast.Tuple) and len(node.elts) == len(numbers) and ast.unparse(node) == str(numbers)


@pytest.mark.parametrize("name", DISTINCT)
def test_names_of_signals_stand_in_one_module(name: str) -> None:
    found = modules_with(lambda node: isinstance(node, ast.Constant) and node.value == name)
    assert found == {OWN}


def test_colours_of_cells_and_orders_of_passes_stand_in_one_module() -> None:
    assert modules_with(is_twice_a_remainder) == {OWN}
    assert modules_with(lambda node: is_tuple(node, PassOrder.DIAGONAL.colours)) == {OWN}


def described(signal: Signal) -> tuple[str, str]:
    """Type and direction as the page spells them."""
    kind = TYPES[signal.dtype] + (" (nx, ny)" if signal.is_map else "") + (f", {signal.unit}" * (signal.unit != "1"))
    if not signal.giver and not signal.takers:
        return kind, "each"
    return kind, f"{signal.giver or 'master'} → {', '.join(signal.takers) or 'master'}"


def test_page_of_the_contract_agrees_with_the_table() -> None:
    rows = ROW.findall((ROOT / "docs/reference/layer-contract.md").read_text(encoding="utf-8"))
    assert {name: (kind.removesuffix("; in FMUs an enumeration"), way) for name, kind, way, _ in rows} == {
        name: described(signal) for name, signal in SIGNALS.items()
    }
    assert [name for name, *_ in rows] == list(SIGNALS)
    assert {name for name, _, _, text in rows if "optional, default" in text} == {
        name for name, signal in SIGNALS.items() if signal.is_optional
    }


@pytest.mark.parametrize("signal", SIGNALS.values(), ids=list(SIGNALS))
def test_a_map_has_the_shape_of_the_grid_and_a_number_has_none(signal: Signal) -> None:
    port = Port(signal.name, signal.unit, (3, 4) if signal.is_map else (), signal.dtype, signal.start)
    assert signal.port((3, 4)) == port
    assert contract_ports((3, 4), signal.name, LAYER_COMMAND) == (port, SIGNALS[LAYER_COMMAND].port((3, 4)))


def test_ports_are_equal_where_all_of_their_elements_start_alike() -> None:
    row, column = (Port("x", shape=(2, 2), start=np.array([[1.0, 2.0]]).reshape(form)) for form in ((1, 2), (2, 1)))
    assert row != column
    assert row == Port("x", shape=(2, 2), start=np.array([[1.0, 2.0]]))
    for one, other in ((0.0, -0.0), (np.nan, float("nan"))):
        assert Port("x", start=one) == Port("x", start=other)
        assert hash(Port("x", start=one)) == hash(Port("x", start=other))
    others: list[object] = [
        Port("y"),
        Port("x", "m"),
        Port("x", shape=(1,)),
        Port("x", dtype="int32"),
        Port("x", start=1.0),
        "x",
    ]
    assert Port("x") not in others


@pytest.mark.parametrize("path", sorted((ROOT / "fmus").glob("*/variables.toml")), ids=lambda path: path.parent.name)
def test_fmus_declare_the_signals_as_the_table_does(path: Path) -> None:
    """Sequence numbers and optional signals also start from the same value; a map without a connection may differ."""
    variables = tomllib.loads(path.read_text(encoding="utf-8"))["variables"]
    for name in variables.keys() & SIGNALS.keys():
        found, signal = variables[name], SIGNALS[name]
        kind = "integer" if found.get("type") == "enumeration" else found.get("type", "real")
        form = (kind, found.get("unit", "1"), found.get("shape") == "grid")
        assert form == (TYPES[signal.dtype], signal.unit, signal.is_map), name
        if "start" in found and (name in COUNTERS or signal.is_optional):
            assert found["start"] == signal.start, name


def test_controller_has_the_ports_that_the_table_gives_its_role() -> None:
    part = job()
    controller = LayerController(part, OpenLoop(part), HeightEstimator(part))
    shape = (part.nx, part.ny)
    inputs = {signal.port(shape) for signal in SIGNALS.values() if "controller" in signal.takers}
    outputs = {
        signal.port(shape)
        for signal in SIGNALS.values()
        if signal.giver == "controller" or not (signal.giver or signal.takers)
    }
    assert set(controller.inputs) == inputs
    assert outputs <= set(controller.outputs)
    assert not contract_connections({"controller": controller})


@pytest.mark.parametrize("command", [4, 5])
def test_command_repeats_the_last_layer_or_is_the_next(command: int) -> None:
    assert checked_command({LAYER_COMMAND: np.asarray(command)}, 4) == command


@pytest.mark.parametrize("command", [-1, 3, 6])
def test_other_commands_are_refused(command: int) -> None:
    with pytest.raises(ComponentError, match=f"layer_command is {command} after layer 4; needs 4 or 5"):
        checked_command({LAYER_COMMAND: np.asarray(command)}, 4)


def test_orders_of_the_scenario_are_those_of_the_passes() -> None:
    names = schema.Process.model_json_schema()["properties"]["pass_order"]["enum"]
    assert [name.upper() for name in names] == [order.name for order in PassOrder]


def test_every_colour_is_jetted_once_in_a_layer() -> None:
    assert sorted(pass_colour(*np.indices((2, 2))).ravel()) == [0, 1, 2, 3]
    for order in PassOrder:
        for layer in range(1, 6):
            assert sorted(pass_colours(4, order, 1, layer)) == [0, 1, 2, 3]
    assert pass_colours(1, 1, 0, 1) == ()
    assert pass_colours(4, PassOrder.DIAGONAL, 1, 1) == (3, 1, 2, 0)

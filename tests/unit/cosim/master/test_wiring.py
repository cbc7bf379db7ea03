from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Port
from inkloop.master.wiring import Connection, Transfer, check, feeds
from support.toys import FunctionComponent


def test_shape_that_differs_is_no_matter_of_gains() -> None:
    source, target = Port("y", "%", (3, 2)), Port("x", "1", (2, 3), "float32")
    parts = {"a": FunctionComponent(outputs=[source]), "b": FunctionComponent(inputs=[target])}
    assert check(parts, [Connection("a.y", "b.x", 0.01)]) == [
        "a.y gives 3 x 2, b.x takes 2 x 3: same shape needed",
        "a.y gives float64, b.x takes float32: same type needed",
    ]


@pytest.mark.parametrize(("source", "target"), [("%", "1"), ("degC", "K"), ("m", "V")])
def test_gain_leads_to_a_unit_that_is_not_known_here(source: str, target: str) -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y", source)]), "b": FunctionComponent(inputs=[Port("x", target)])}
    (error,) = check(parts, [Connection("a.y", "b.x")])
    assert error.endswith(f"same quantity needed, or a gain that converts [{source}] into [{target}]")
    assert fed(Connection("a.y", "b.x", 0.01, 1.0), source, target, 50.0) == 1.5


@pytest.mark.parametrize(
    ("connection", "message"),
    [
        (Connection("aa.y", "b.x"), "aa.y: there is no component 'aa'; did you mean a?"),
        (Connection("a.yy", "b.x"), "a.yy: a has no output 'yy'; did you mean y?"),
        (Connection("a.y", "b.xx"), "b.xx: b has no input 'xx'; did you mean x?"),
        (Connection("b.y", "b.x"), "b.y: b has no output 'y'; it has no outputs"),
    ],
)
def test_unknown_end_is_answered_with_the_nearest_known(connection: Connection, message: str) -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y")]), "b": FunctionComponent(inputs=[Port("x")])}
    assert check(parts, [connection]) == [message]


def fed(connection: Connection, source: str, target: str, value: float) -> float:
    parts = {"a": FunctionComponent(outputs=[Port("y", source)]), "b": FunctionComponent(inputs=[Port("x", target)])}
    assert check(parts, [connection]) == []
    ((port, component, output, transfer),) = feeds(parts, [connection])["b"]
    assert (port, component, output) == ("x", "a", "y")
    return float(transfer(np.asarray(value)))


@pytest.mark.parametrize("dtype", ["int32", "bool"])
def test_gain_is_of_floating_point_values_only(dtype: str) -> None:
    port: dict[str, Any] = {"dtype": dtype}
    parts = {"a": FunctionComponent(outputs=[Port("y", **port)]), "b": FunctionComponent(inputs=[Port("x", **port)])}
    assert check(parts, [Connection("a.y", "b.x")]) == []
    (error,) = check(parts, [Connection("a.y", "b.x", gain=2.0)])
    assert error.startswith(f"a.y is {dtype}; a gain, an offset or another unit needs floating-point values")


@pytest.mark.parametrize(
    ("source", "target", "gain", "offset", "given", "expected"),
    [
        ("m", "um", 1.0, 0.0, 2e-6, 2.0),
        ("s", "ms", 1.0, 0.0, 0.5, 500.0),
        ("deg", "rad", 1.0, 0.0, 180.0, np.pi),
        ("V", "V", 1.0, 0.0, 5.0, 5.0),
        ("m", "m", 1.0, 2.0, 3.0, 5.0),
        ("m", "um", 2.0, 5.0, 3e-6, 11.0),  # the unit, then the gain, then the offset
    ],
)
def test_value_arrives_in_the_unit_of_the_input(
    source: str, target: str, gain: float, offset: float, given: float, expected: float
) -> None:
    found = fed(Connection("a.y", "b.x", gain, offset), source, target, given)
    assert found == pytest.approx(expected, rel=1e-9, abs=0.0)


def test_array_on_its_way_is_that_of_its_source_or_has_its_type_and_cannot_be_written() -> None:
    assert Transfer()(value := np.ones(3)) is value
    arrived = Transfer(factor=2.0)(np.ones(3, np.float32))
    assert arrived.dtype == np.float32
    assert not arrived.flags.writeable


@pytest.mark.parametrize(
    ("port", "gain", "message"),
    [
        (Port("y", "s"), 1.0, "a.y gives [s], b.x takes [m]: same quantity needed"),
        (Port("y", "s"), 2.0, "a.y gives [s], b.x takes [m]: same quantity needed"),
        (Port("y", "m", (3,)), 1.0, "a.y gives 3, b.x takes a scalar"),
        (Port("y", "m", dtype="int32"), 1.0, "a.y gives int32, b.x takes float64"),
    ],
)
def test_mismatch_is_named_with_both_sides(port: Port, gain: float, message: str) -> None:
    parts = {"a": FunctionComponent(outputs=[port]), "b": FunctionComponent(inputs=[Port("x", "m")])}
    wires = [Connection("a.y", "b.x", gain)] * 2
    error, *_, twice = check(parts, wires)
    assert error.startswith(message)
    assert twice.startswith("b.x is fed twice, by a.y and a.y")

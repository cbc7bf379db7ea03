from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Port
from inkloop.master.orientation import Orientation
from inkloop.master.wiring import Connection, Transfer, check, feeds, initial_order
from inkloop.units import DefinedUnit
from support.toys import FunctionComponent


def test_shape_that_differs_is_no_matter_of_gains() -> None:
    source, target = Port("y", "%", (3, 2)), Port("x", "1", (2, 3), "float32")
    parts = {"a": FunctionComponent(outputs=[source]), "b": FunctionComponent(inputs=[target])}
    assert check(parts, [Connection("a.y", "b.x", 0.01)]) == [
        "a.y gives 3 x 2, b.x takes 2 x 3: same shape needed; transpose in the connection, or in ports of an FMU, "
        "exchanges the axes",
        "a.y gives float64, b.x takes float32, which does not hold all its values; put a component between them that "
        "rounds or limits (docs/how-to/bring-your-own-component.md)",
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
    assert error.startswith(f"b.x is {dtype}; a gain, an offset or another unit needs floating-point values")


@pytest.mark.parametrize(
    ("narrow", "wide"),
    [("float32", "float64"), ("int8", "int32"), ("int16", "int32"), ("uint8", "int16"), ("bool", "int32"),
     ("int32", "float64"), ("int16", "float32"), ("int32", "int64"), ("bool", "float32")],
)  # fmt: skip
def test_wider_type_takes_every_value_and_narrower_is_refused(narrow: str, wide: str) -> None:
    ports = {"narrow": Port("y", dtype=narrow), "wide": Port("x", dtype=wide)}
    parts = {"a": FunctionComponent(outputs=[ports["narrow"]]), "b": FunctionComponent(inputs=[ports["wide"]])}
    wire = Connection("a.y", "b.x")
    assert check(parts, [wire]) == []
    value = np.asarray(1 if narrow == "bool" else np.finfo(narrow).max if "float" in narrow else np.iinfo(narrow).max)
    arrived = Transfer.of(wire, ports["narrow"], ports["wide"])(value.astype(narrow))
    assert arrived.dtype == wide
    assert arrived == value
    assert not arrived.flags.writeable
    back = {
        "a": FunctionComponent(outputs=[Port("y", dtype=wide)]),
        "b": FunctionComponent(inputs=[Port("x", dtype=narrow)]),
    }
    (error,) = check(back, [wire])
    assert error.startswith(f"a.y gives {wide}, b.x takes {narrow}, which does not hold all its values")


@pytest.mark.parametrize(("source", "target"), [("int64", "float64"), ("uint64", "float64"), ("int32", "float32")])
def test_real_number_that_skips_whole_ones_is_not_wider(source: str, target: str) -> None:
    parts = {
        "a": FunctionComponent(outputs=[Port("y", dtype=source)]),
        "b": FunctionComponent(inputs=[Port("x", dtype=target)]),
    }
    (error,) = check(parts, [Connection("a.y", "b.x")])
    assert "does not hold all its values" in error


def test_whole_number_gets_a_gain_on_its_way_to_a_real_input() -> None:
    ports = Port("y", dtype="int32"), Port("x", dtype="float64")
    parts = {"a": FunctionComponent(outputs=[ports[0]]), "b": FunctionComponent(inputs=[ports[1]])}
    wire = Connection("a.y", "b.x", gain=0.5, offset=0.25)
    assert check(parts, [wire]) == []
    assert float(Transfer.of(wire, *ports)(np.asarray(3, np.int32))) == 1.75


CELSIUS, FAHRENHEIT = DefinedUnit("degC", "K", 1.0, 273.15), DefinedUnit("degF", "K", 5 / 9, 459.67 * 5 / 9)


@pytest.mark.parametrize(
    ("source", "target", "given", "expected"),
    [(CELSIUS, "K", 20.0, 293.15), ("K", CELSIUS, 293.15, 20.0), (CELSIUS, FAHRENHEIT, 100.0, 212.0),
     (FAHRENHEIT, CELSIUS, -40.0, -40.0), (CELSIUS, CELSIUS, 20.0, 20.0)],
)  # fmt: skip
def test_unit_with_an_offset_is_converted_by_itself(source: str, target: str, given: float, expected: float) -> None:
    assert fed(Connection("a.y", "b.x"), source, target, given) == pytest.approx(expected, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("wire", [Connection("a.y", "b.x", *line) for line in ((1.0, 273.15), (1.0,), (None, 5.0))])
def test_gain_or_offset_beside_such_a_conversion_is_refused(wire: Connection) -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y", CELSIUS)]), "b": FunctionComponent(inputs=[Port("x", "K")])}
    (error,) = check(parts, [wire])
    assert error == (
        "a.y gives [degC], b.x takes [K]: these are converted by themselves, offset included; leave gain and offset out"
    )


@pytest.mark.parametrize(("nx", "ny"), [(2, 3), (3, 2)])
@pytest.mark.parametrize("transpose", [False, True])
@pytest.mark.parametrize("mirror", ["none", "x", "y", "xy"])
def test_map_arrives_in_the_orientation_of_the_input(nx: int, ny: int, transpose: bool, mirror: Any) -> None:
    value = np.arange(6.0).reshape(nx, ny)
    ports = Port("y", "m", (nx, ny)), Port("x", "mm", (ny, nx) if transpose else (nx, ny))
    parts = {"a": FunctionComponent(outputs=[ports[0]]), "b": FunctionComponent(inputs=[ports[1]])}
    wire = Connection("a.y", "b.x", orientation=Orientation(mirror, transpose))
    assert check(parts, [wire]) == []
    arrived = Transfer.of(wire, *ports)(value)
    np.testing.assert_array_equal(wire.orientation.here(wire.orientation.there(value)), value)
    for i in range(nx):
        for j in range(ny):
            k, m = nx - 1 - i if "x" in mirror else i, ny - 1 - j if "y" in mirror else j
            assert arrived[(m, k) if transpose else (k, m)] == 1e3 * value[i, j]
    assert not arrived.flags.writeable


def test_turn_of_a_scalar_is_refused_and_a_turned_map_gets_advice() -> None:
    parts = {
        "a": FunctionComponent(outputs=[Port("y"), Port("z", shape=(2, 3))]),
        "b": FunctionComponent(inputs=[Port("x"), Port("w", shape=(3, 2))]),
    }
    errors = check(parts, [Connection("a.y", "b.x", orientation=Orientation("x")), Connection("a.z", "b.w")])
    assert errors == [
        "a.y gives a scalar; mirror and transpose turn maps: leave them out",
        "a.z gives 2 x 3, b.w takes 3 x 2: same shape needed; transpose in the connection, or in ports of an FMU, "
        "exchanges the axes",
    ]


def test_map_of_another_grid_gets_advice_and_one_of_other_dimensions_none() -> None:
    parts = {
        "a": FunctionComponent(outputs=[Port("y", shape=(2, 3))]),
        "b": FunctionComponent(inputs=[Port("x", shape=(2, 4)), Port("w", shape=(6,))]),
    }
    grid, line = check(parts, [Connection("a.y", "b.x"), Connection("a.y", "b.w")])
    assert grid == (
        "a.y gives 2 x 3, b.x takes 2 x 4: same shape needed; "
        "write under [grid] the nx and ny of the one that has no other"
    )
    assert line == "a.y gives 2 x 3, b.w takes 6: same shape needed"


def test_component_that_feeds_itself_waits_for_its_other_sources_only() -> None:
    parts = {name: FunctionComponent([Port("x"), Port("own")], [Port("y")]) for name in "bac"}
    wires = [Connection("a.y", "a.own"), Connection("a.y", "b.x"), Connection("b.y", "c.x"), Connection("c.y", "c.own")]
    assert initial_order(feeds(parts, wires)) == ["a", "b", "c"]


def test_gain_of_one_is_a_gain() -> None:
    """Two names for one unit that neither FMU defines."""
    assert fed(Connection("a.y", "b.x", 1.0), "clicks", "ticks", 3.0) == 3.0


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
    arrived = Transfer(factor=2.0, dtype="float32")(np.ones(3, np.float32))
    assert arrived.dtype == np.float32
    assert not arrived.flags.writeable


@pytest.mark.parametrize(
    ("port", "gain", "message"),
    [
        (Port("y", "s"), 1.0, "a.y gives [s], b.x takes [m]: same quantity needed"),
        (Port("y", "s"), 2.0, "a.y gives [s], b.x takes [m]: same quantity needed"),
        (Port("y", "1"), 2.0, "a.y gives [1], b.x takes [m]: same quantity needed"),
        (Port("y", "m", (3,)), 1.0, "a.y gives 3, b.x takes a scalar"),
        (Port("y", "m", dtype="int64"), 1.0, "a.y gives int64, b.x takes float64"),
    ],
)
def test_mismatch_is_named_with_both_sides(port: Port, gain: float, message: str) -> None:
    parts = {"a": FunctionComponent(outputs=[port]), "b": FunctionComponent(inputs=[Port("x", "m")])}
    wires = [Connection("a.y", "b.x", gain)] * 2
    error, *_, twice = check(parts, wires)
    assert error.startswith(message)
    assert "or a gain" not in error
    assert twice.startswith("b.x is fed twice, by a.y and a.y")

"""Mapping of an FMU's variables to ports: values in both directions, and error messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job, Port
from inkloop.components.port_mapping import MappedPort
from inkloop.components.port_tables import mapped_ports
from inkloop.errors import ComponentError
from inkloop.units import defined_unit

JOB = Job(2, 3, pitch=1e-4, target_height=np.full((2, 3), 1e-3), mask=np.ones((2, 3), dtype=np.bool_))
MAP = np.arange(6.0).reshape(2, 3)


def the_one(inputs: list[Port], outputs: list[Port], option: Mapping[str, Any]) -> MappedPort:
    """The only port that a faultless option maps."""
    into, out, errors = mapped_ports(inputs, outputs, JOB, option)
    assert not errors
    (found,) = [*into, *out]
    return found


@pytest.mark.parametrize("shape", [(2, 3), (6,)])
def test_map_goes_to_one_array_of_the_fmu_in_its_shape(shape: tuple[int, ...]) -> None:
    mapped = the_one([Port("U", shape=shape)], [], {"pattern": {"variable": "U", "gain": 2.5}})
    given = mapped.to_fmu(MAP.astype(np.int32))["U"]
    assert given.shape == shape
    assert given.dtype == np.float64
    np.testing.assert_array_equal(given.reshape(2, 3), 2.5 * MAP)


TURNS = {
    ("none", False): [[0, 1, 2], [3, 4, 5]],
    ("x", False): [[3, 4, 5], [0, 1, 2]],
    ("y", False): [[2, 1, 0], [5, 4, 3]],
    ("xy", False): [[5, 4, 3], [2, 1, 0]],
    ("none", True): [[0, 3], [1, 4], [2, 5]],
    ("x", True): [[3, 0], [4, 1], [5, 2]],
    ("y", True): [[2, 5], [1, 4], [0, 3]],
    ("xy", True): [[5, 2], [4, 1], [3, 0]],
}
"""The map 0 to 5 of 2 x 3 cells, as an FMU has it that counts these axes the other way, or y first."""


@pytest.mark.parametrize(("mirror", "transpose"), TURNS)
@pytest.mark.parametrize("form", ["array", "flat", "scalars"])
def test_map_of_an_fmu_with_other_axes_arrives_turned(mirror: str, transpose: bool, form: str) -> None:
    there = np.array(TURNS[mirror, transpose], float)
    option = {"height": {"variable": "U{n}" if form == "scalars" else "U", "mirror": mirror, "transpose": transpose}}
    if form == "scalars":
        ports = [Port(f"U{n}", "m") for n in range(1, 7)]
        values = {f"U{n}": np.asarray(value) for n, value in enumerate(there.flat, start=1)}
    else:
        shape = there.shape if form == "array" else (6,)
        ports, values = [Port("U", "m", shape)], {"U": there.reshape(shape)}
    coming, going = the_one([], ports, option), the_one(ports, [], option)
    np.testing.assert_array_equal(coming.from_fmu(values), MAP)
    given = going.to_fmu(MAP)
    assert {name: value.tolist() for name, value in given.items()} == {
        name: value.tolist() for name, value in values.items()
    }


@pytest.mark.parametrize(
    ("name", "table", "error"),
    [
        ("height", {"variable": "z"}, "ports.height.variable is 'z' of 3 x 2; needs 2 x 3: write transpose = true if "
         "its first index goes along y"),
        ("height", {"variable": "long"}, "ports.height.variable is 'long' of 1 x 6; needs 2 x 3: take its grid"),
        ("status", {"variable": "s", "transpose": True}, "ports.status.transpose turns maps, and status is none; "
         "leave it out"),
        ("height", {"variable": "z", "mirror": "z"}, "ports.height.mirror is 'z'; expected 'none', 'x', 'y' or 'xy' "
         "(axes that count the other way there)"),
    ],
)  # fmt: skip
def test_map_in_another_order_is_refused_not_scrambled(name: str, table: dict[str, Any], error: str) -> None:
    outputs = [Port("z", "m", (3, 2)), Port("s", dtype="int32"), Port("long", "m", (1, 6))]
    *_, errors = mapped_ports([], outputs, JOB, {name: table})
    assert errors == [error]


@pytest.mark.parametrize(
    ("template", "first", "last"), [("z_{i}_{j}", "z_0_0", "z_1_2"), ("z{n}", "z0", "z5"), ("z{j}.{i}", "z0.0", "z2.1")]
)
def test_scalars_of_a_template_are_cells_of_the_map(template: str, first: str, last: str) -> None:
    names = [template.format(i=i, j=j, n=3 * i + j) for i in range(2) for j in range(3)]
    option = {"height": {"variable": template, "first": 0, "unit": "um"}}
    mapped = the_one([], [Port(name) for name in sorted(names, reverse=True)], option)
    values = {name: np.asarray(value) for name, value in zip(names, MAP.flat, strict=True)}
    np.testing.assert_allclose(mapped.from_fmu(values), MAP * 1e-6, rtol=1e-15)
    assert (names[0], names[-1]) == (first, last)


def test_calibration_reads_the_same_both_ways() -> None:
    option = {"height": {"variable": "U", "unit": "um", "gain": 0.02, "offset": 0.5}}
    going = the_one([Port("U", shape=(2, 3))], [], option)
    coming = the_one([], [Port("U", shape=(2, 3))], option)
    volts = going.to_fmu(MAP * 1e-6)
    np.testing.assert_allclose(volts["U"], 0.5 + 0.02 * MAP, rtol=1e-12)
    np.testing.assert_allclose(coming.from_fmu(volts), MAP * 1e-6, atol=1e-18)


def test_offset_without_a_gain_is_taken_off_again() -> None:
    option = {"height": {"variable": "U", "offset": 0.5}}
    coming = the_one([], [Port("U", "m", (2, 3))], option)
    np.testing.assert_allclose(coming.from_fmu({"U": MAP + 0.5}), MAP, rtol=0.0, atol=1e-15)


def test_indices_of_a_transposed_template_are_those_of_the_fmu() -> None:
    """Three rows of two there, two by three cells here."""
    ports = [Port(f"U{i}{j}", "m") for i in (1, 2, 3) for j in (1, 2)]
    mapped = the_one([], ports, {"height": {"variable": "U{i}{j}", "transpose": True}})
    values = {f"U{i}{j}": np.asarray(MAP[j - 1, i - 1]) for i in (1, 2, 3) for j in (1, 2)}
    np.testing.assert_array_equal(mapped.from_fmu(values), MAP)


def test_gain_is_that_of_a_unit_with_its_own_zero() -> None:
    """Twice the micrometres above 5 um, and one."""
    gauge = defined_unit("gauge", {"m": 1}, 1e-6, 5e-6)
    mapped = the_one([Port("U", gauge, (2, 3))], [], {"height": {"variable": "U", "gain": 2.0, "offset": 1.0}})
    np.testing.assert_allclose(mapped.to_fmu(MAP * 1e-6)["U"], 2.0 * (MAP - 5.0) + 1.0, rtol=1e-9)


def test_port_of_no_contract_starts_as_its_variable_in_si() -> None:
    mapped = the_one([], [Port("T", "mm", start=41.0)], {"gap": "T"})
    assert (mapped.port.unit, mapped.port.start_value()) == ("m", pytest.approx(0.041, rel=1e-9, abs=0.0))


def test_height_in_another_unit_is_mapped_by_itself() -> None:
    mapped = the_one([], [Port("height", "mm", (2, 3))], {})
    np.testing.assert_allclose(mapped.from_fmu({"height": MAP}), MAP * 1e-3, rtol=1e-12)
    assert mapped_ports([], [Port("height", "m", (2, 3))], JOB, {}) == ([], [], [])


def test_truth_of_a_number_is_that_it_is_not_zero() -> None:
    mapped = the_one([], [Port("seen", shape=(2, 3))], {"valid": "seen"})
    np.testing.assert_array_equal(mapped.from_fmu({"seen": MAP - 2.0}), MAP != 2.0)


def test_counters_of_real_numbers_must_be_whole() -> None:
    mapped = the_one([], [Port("n")], {"layers_printed": "n"})
    assert mapped.from_fmu({"n": np.asarray(3.0)}).dtype == np.int32
    with pytest.raises(ComponentError, match=r"layers_printed, read from n, is 1\.5; needs whole numbers"):
        mapped.from_fmu({"n": np.asarray(1.5)})


def test_scalars_of_a_map_are_named_from_the_first_to_the_last() -> None:
    ports = [Port(f"n{n}") for n in range(1, 7)]
    mapped = the_one([], ports, {"pattern": "n{n}"})
    with pytest.raises(ComponentError, match=r"pattern, read from n1 to n6, is 0\.5; needs whole numbers"):
        mapped.from_fmu({port.name: np.asarray(0.5) for port in ports})


@pytest.mark.parametrize("value", [3e9, np.nan, np.inf])
def test_number_beyond_its_type_is_refused(value: float) -> None:
    mapped = the_one([], [Port("n", "1")], {"layers_printed": "n"})
    with pytest.raises(ComponentError, match=r"layers_printed, read from n, is .*; needs whole numbers that int32"):
        mapped.from_fmu({"n": np.asarray(value)})


@pytest.mark.parametrize(("dtype", "most", "needed"), [("int8", 127, "whole numbers that int8 holds"),
                                                       ("uint8", 255, "whole numbers that uint8"),
                                                       ("bool", 1, "0 or 1")])  # fmt: skip
def test_pattern_beyond_the_type_of_the_fmu_is_refused(dtype: str, most: int, needed: str) -> None:
    mapped = the_one([Port("U", shape=(2, 3), dtype=dtype)], [], {"pattern": "U"})
    given = np.full((2, 3), most, np.int32)
    np.testing.assert_array_equal(mapped.to_fmu(given)["U"], given)
    with pytest.raises(ComponentError, match=f"pattern, given to U, is {most + 1}; needs {needed}"):
        mapped.to_fmu(given + 1)


def test_template_pads_with_zeros() -> None:
    ports = [Port(f"z{i:02}.{j}", "m") for i in (0, 1) for j in (0, 1, 2)]
    mapped = the_one([], ports, {"height": {"variable": "z{i:02}.{j}", "first": 0}})
    np.testing.assert_array_equal(
        mapped.from_fmu({port.name: np.asarray(value) for port, value in zip(ports, MAP.flat, strict=True)}), MAP
    )


def test_unit_that_the_fmu_defines_of_another_quantity_is_not_overridden() -> None:
    """A gain converts it; a name that the FMU gives a mere number does not count."""

    def errors(unit: str, **more: float) -> list[str]:
        table = {"height": {"variable": "U", "unit": "um", **more}}
        return mapped_ports([], [Port("U", unit, (2, 3))], JOB, table)[2]

    warm = defined_unit("degC", {"K": 1}, 1.0, 273.15)
    assert errors(warm) == ["ports.height.unit is 'um', but the FMU declares U in [degC]; leave it out"]
    assert errors(defined_unit("K", {"K": 1}, 1.0, 0.0)) == [
        "ports.height.unit is 'um', but the FMU declares U in [K]; leave it out"
    ]
    assert errors(warm, gain=2.0) == errors(defined_unit("count", {}, 1.0, 0.0)) == errors("1") == []


def test_every_error_is_named_at_once_with_its_key() -> None:
    inputs = [Port("U", shape=(2, 3), dtype="int32"), Port("command", dtype="int32"), Port("row", shape=(3,))]
    outputs = [Port("z", shape=(2, 3)), Port("height", "m", (2, 3)), Port("x", "mm", (2, 3))]
    option = {
        "pattern": {"variable": "U", "gain": 2.0},
        "layer_command": "comand",
        "drop_level": "row",
        "height": "z",
        "measured_height": {"variable": "x", "unit": "um"},
        "status": {"variable": "command", "gian": 1.0},
        "valid": 3,
    }
    expected = {
        "ports.pattern": "of type int32; a unit, gain or offset needs a real one",
        "ports.layer_command": "'comand', which is no input or output of the FMU; did you mean command",
        "ports.drop_level": "'row' with 3 values; needs 2 x 3 values, as the grid; take the grid of the FMU",
        "ports.height.variable": "'z' in [1]; needs a unit of the quantity [m]: write unit, one of um, mm",
        "ports.measured_height.unit": "'um', but the FMU declares x in [mm]; leave it out",
        "ports.status.gian": "is not a key of this table",
        "ports.valid": "is 3; expected the name of a variable, or a table with it",
    }
    errors = mapped_ports(inputs, outputs, JOB, option)[2]
    for place, words in expected.items():
        assert [error for error in errors if error.startswith(place) and words in error], (place, errors)
    assert len(errors) == len(expected)


def test_gain_leads_to_units_that_inkloop_does_not_know() -> None:
    """A dose in picolitres, a sensor in volts, a height in whatever "micrometer" is: none of them a dead end."""
    inputs = [Port("dose", "pl", (2, 3)), Port("U", "V", (2, 3)), Port("z", "micrometer", (2, 3))]
    option = {
        "pattern": {"variable": "dose", "gain": 10.0},
        "measured_height": {"variable": "U", "unit": "um", "gain": 0.02, "offset": 0.5},
        "height": {"variable": "z", "unit": "um"},
    }
    mapped, _, errors = mapped_ports(inputs, [], JOB, option)
    assert errors == []
    given = {each.port.name: each.to_fmu(np.full((2, 3), 1e-5 if each.port.unit == "m" else 1)) for each in mapped}
    assert given["pattern"]["dose"][0, 0] == 10.0
    assert given["measured_height"]["U"][0, 0] == pytest.approx(0.7, rel=1e-9, abs=0.0)
    assert given["height"]["z"][0, 0] == pytest.approx(10.0, rel=1e-9, abs=0.0)


MAP_OF_M = Port("z", "m", (2, 3))


@pytest.mark.parametrize(
    ("outputs", "option", "message"),
    [
        ([Port("z", shape=(2, 3), dtype="int32")], {"pattern": {"variable": "z", "offset": 0.5}}, "needs a real one"),
        ([Port("z", shape=(2, 3))], {"pattern": {"variable": "z", "unit": "m"}}, "but this signal is a number without"),
        (
            [MAP_OF_M],
            {"height": "z[{i},{j}]"},
            "so 'z[1,1]', which is no input or output of the FMU; its scalars are j",
        ),
        ([MAP_OF_M], {"height": "z", "measured_height": "z"}, "stands behind two ports"),
        ([MAP_OF_M], {"height": {"variable": "z", "gain": 0.0}}, "ports.height.gain is 0; needs another number"),
        ([MAP_OF_M, Port("height", "m", (2, 3))], {"height": "z"}, "also has a variable of that name"),
        ([Port("z1"), Port("z2")], {"height": "z{i}"}, "one name for several of 2 x 3 cells; write both {i} and {j}"),
    ],
)
def test_mapping_that_is_none_is_an_error(outputs: list[Port], option: dict[str, Any], message: str) -> None:
    assert message in mapped_ports([], outputs, JOB, option)[2][0]

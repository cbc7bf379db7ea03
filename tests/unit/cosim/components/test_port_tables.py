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

JOB = Job(2, 3, pitch=1e-4, target_height=np.ones((2, 3)), mask=np.ones((2, 3), dtype=np.bool_))
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


def test_counters_of_real_numbers_must_be_whole() -> None:
    mapped = the_one([], [Port("n")], {"layers_printed": "n"})
    assert mapped.from_fmu({"n": np.asarray(3.0)}).dtype == np.int32
    with pytest.raises(ComponentError, match=r"layers_printed is .*1\.5.*, read from n; needs whole numbers"):
        mapped.from_fmu({"n": np.asarray(1.5)})


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
        "ports.drop_level": "'row' with 3 values; needs 2 x 3 values, as the grid",
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
        ([MAP_OF_M, Port("height", "m", (2, 3))], {"height": "z"}, "also has a variable of that name"),
        ([Port("z1"), Port("z2")], {"height": "z{i}"}, "one name for several of 2 x 3 cells; write both {i} and {j}"),
    ],
)
def test_mapping_that_is_none_is_an_error(outputs: list[Port], option: dict[str, Any], message: str) -> None:
    assert message in mapped_ports([], outputs, JOB, option)[2][0]

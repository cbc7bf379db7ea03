"""Values that a variable of an FMU accepts, and messages for the others; conversions between units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.fmu import Variable
from inkloop.fmu.variable import summary
from inkloop.units import conversion, defined_unit, is_defined, is_known, si_unit, unit_conversion

SIZES = {"nx": 2}
FORCE = {"kg": 1, "m": 1, "s": -2}


def variable(kind: str, **more: Any) -> Variable:
    return Variable("v", kind, "parameter", "fixed", (1,), **more)


LENGTH = variable("Float64", unit="m", minimum="-1", maximum="2.5")
COUNT = variable("Int16", minimum="0")
MAP = variable("UInt8", dimensions=("nx", 3), maximum="9")
SWITCH = variable("Boolean")
MODE = variable("Enumeration", items={"off": 0, "full": 4})
LONG = variable("Enumeration", items={"off": 0, "full": 2**31})


@pytest.mark.parametrize(
    ("of", "value", "expected", "dtype"),
    [
        (LENGTH, -1, -1.0, "float64"),
        (LENGTH, 2.5, 2.5, "float64"),
        (COUNT, 0, 0, "int16"),
        (MAP, 9, np.full((2, 3), 9), "uint8"),
        (MAP, [[1, 2, 3], [4, 5, 6]], [[1, 2, 3], [4, 5, 6]], "uint8"),
        (SWITCH, True, True, "bool"),
        (MODE, "full", 4, "int32"),
        (MODE, 0, 0, "int32"),
        (LONG, "full", 2**31, "int64"),
        (variable("Enumeration", items={"low": -(2**31)}), "low", -(2**31), "int32"),
        (variable("Enumeration", items={"low": -(2**31) - 1}), "low", -(2**31) - 1, "int64"),
        (LENGTH, np.uint8(2), 2.0, "float64"),
        (COUNT, np.uint8(2), 2, "int16"),
        (MAP, np.asfortranarray([[1, 2, 3], [4, 5, 6]]), [[1, 2, 3], [4, 5, 6]], "uint8"),
    ],
)
def test_value_within_its_limits_is_taken(of: Variable, value: Any, expected: Any, dtype: str) -> None:
    found = of.convert(value, SIZES)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, expected)
    assert found.shape == np.shape(expected)
    assert found.flags.c_contiguous


@pytest.mark.parametrize(
    ("of", "value", "message"),
    [
        (LENGTH, 2.6, r"is 2\.6; expected a number in -1 \.\. 2\.5 \[m\]$"),
        (LENGTH, -1.1, r"is -1\.1; expected a number in -1 \.\. 2\.5 \[m\]$"),
        (variable("Float64"), np.nan, r"is nan; expected a number$"),
        (variable("Float64"), np.inf, r"is inf; expected a number$"),
        (LENGTH, True, r"is True; expected a number"),
        (LENGTH, "long", r"is 'long'; expected a number"),
        (COUNT, -1, r"is -1; expected a whole number >= 0$"),
        (COUNT, 1.0, r"is 1\.0; expected a whole number >= 0$"),
        (MAP, 10, r"is 10; expected a whole number <= 9, or 2 x 3 of them$"),
        (
            MAP,
            [[1, 2], [3, 4], [5, 6]],
            r"is 3 x 2 values from 1 to 6; expected a whole number <= 9, or 2 x 3 of them$",
        ),
        (MAP, [[1, 2, 3], [4]], r"is no array; expected a whole number <= 9, or 2 x 3 of them$"),
        (SWITCH, 1, r"is 1; expected true or false$"),
        (MODE, "half", r"is 'half'; expected one of 'off' \(0\), 'full' \(4\)$"),
        (MODE, 3, r"is 3; expected one of 'off' \(0\), 'full' \(4\)$"),
    ],
)
def test_value_that_does_not_fit_is_refused_with_what_would(of: Variable, value: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        of.convert(value, SIZES)


@pytest.mark.parametrize(
    ("of", "fault"),
    [
        (variable("Float64", dimensions=(0, 3)), None),
        (variable("Float64", dimensions=(-1, 3)), "has the dimensions -1 x 3"),
        (variable("Float64", dimensions=64 * (1,)), None),
        (variable("Float64", dimensions=65 * (1,)), f"has the dimensions {' x '.join('1' * 65)}"),
        (variable("Float64", dimensions=(5, 5)), None),
        (variable("Float64", dimensions=(2, 13)), "of 2 x 13 values needs about 0.203 KiB of memory, 0.195 KiB are av"),
        (variable("Int32", start=("1", "2"), dimensions=(3,)), "has 2 start values for 3"),
        (variable("Int32", start=("1", "2")), "has 2 start values for one number"),
        (variable("UInt8", start=("256",)), "has the start value '256'; expected UInt8"),
    ],
)
def test_description_of_a_variable_may_make_no_sense(
    of: Variable, fault: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: 200)
    found = of.fault(SIZES)
    assert found is None if fault is None else str(found).startswith(fault)


@pytest.mark.parametrize(
    ("causality", "variability", "settable"),
    [
        ("parameter", "fixed", True),
        ("parameter", "tunable", True),
        ("structuralParameter", "tunable", True),
        ("parameter", "constant", False),
        ("input", "fixed", False),
        ("local", "fixed", False),
    ],
)
def test_parameters_that_may_change_are_settable(causality: str, variability: str, settable: bool) -> None:
    assert Variable("v", "Float64", causality, variability, (1,)).is_settable is settable


def test_limits_are_shown_in_the_unit_of_a_key() -> None:
    found = LENGTH.in_unit("um", 1e-6)
    assert (found.unit, found.minimum, found.maximum) == ("um", "-1000000", "2500000")
    assert COUNT.in_unit("um", 1e-6).maximum is None
    assert LENGTH.in_unit("m", 1.0) is LENGTH


@pytest.mark.parametrize(
    ("of", "start"),
    [
        (variable("Float64", start=("2.5",), dimensions=(2, 2)), 2.5),
        (variable("Int32", start=("1", "2", "3", "4"), dimensions=(2, 2)), [[1, 2], [3, 4]]),
        (variable("Int32", start=("1", "2"), dimensions=(2, 2)), 0.0),  # of an array that has been resized
        (variable("Int32", start=("3", "3"), dimensions=(2, 2)), 3),  # the same everywhere, whatever the size
        (variable("Boolean", start=("true", "false"), dimensions=(2,)), [True, False]),
        (variable("Float64"), 0.0),
    ],
)
def test_port_begins_with_the_start_values(of: Variable, start: Any) -> None:
    np.testing.assert_array_equal(of.port({}).start, start)


def test_summary_has_type_sizes_unit_start_and_items() -> None:
    assert summary(variable("Float64", unit="m", start=("1", "1"), dimensions=("nx", 3), description="a map")) == (
        "Float64 (nx x 3) [m] = 1  a map"
    )
    assert summary(MODE) == "Enumeration {0 off, 4 full}"
    assert summary(variable("Int32", start=("1", "2"))) == "Int32"


@pytest.mark.parametrize(
    ("source", "target", "factor"),
    [
        ("um", "mm", 1e-3),
        ("min", "ms", 6e4),
        ("m", "s", None),
        ("V", "V", 1.0),
        ("V", "A", None),
        (defined_unit("inch", {"m": 1}, 0.0254, 0.0), "mm", 25.4),
        (defined_unit("m", {"m": 1, "s": 0}, 1e-3, 0.0), "m", 1e-3),  # the definition counts, not the name
        (defined_unit("degC", {"K": 1}, 1.0, 273.15), defined_unit("K", {"K": 1}, 1.0, 0.0), None),
        (defined_unit("N", FORCE, 1.0, 0.0), defined_unit("mN", FORCE, 1e-3, 0.0), 1e3),
    ],
)
def test_units_of_one_quantity_are_converted(source: str, target: str, factor: float | None) -> None:
    found = conversion(source, target)
    assert found == (None if factor is None else pytest.approx(factor, rel=1e-12, abs=0.0))


def test_unit_that_means_what_it_says_stays_a_plain_name() -> None:
    assert type(defined_unit("um", {"m": 1}, 1e-6, 0.0)) is str
    force = defined_unit("mN", {"kg": 1, "m": 1, "s": -2, "A": 0}, 1e-3, 0.0)
    assert si_unit(force) == ("kg.m.s-2", 1e-3)
    assert (is_known(force), is_known("um"), is_known("V")) == (False, True, False)
    assert is_known(defined_unit("inch", {"m": 1}, 0.0254, 0.0))


def test_unit_with_an_offset_is_of_no_quantity_here_whatever_its_name() -> None:
    """Keys and gains know factors alone."""
    level = defined_unit("um", {"m": 1}, 1e-6, 2.0)
    assert (si_unit(level), is_known(level), is_defined(level)) == (("um", 1.0), False, True)
    assert unit_conversion(level, "m") == (1e-6, 2.0)
    assert conversion(level, "m") is None


def test_mere_number_is_no_defined_unit() -> None:
    share, force = defined_unit("%", {}, 0.01, 0.0), defined_unit("N", FORCE, 1.0, 0.0)
    assert [is_defined(unit) for unit in ("m", share, force, "V")] == [True, False, True, False]


def test_unit_that_one_side_defines_is_taken_by_its_name_on_the_other() -> None:
    known = defined_unit("click", FORCE, 3.0, 0.0)
    assert unit_conversion(known, "click") == unit_conversion("click", known) == (1.0, 0.0)
    assert unit_conversion(known, "tick") is None


@pytest.mark.parametrize(("factor", "offset"), [(0.0, 0.0), (np.inf, 0.0), (1.0, np.nan), (1.0, -np.inf)])
def test_definition_that_converts_nothing_is_refused(factor: float, offset: float) -> None:
    with pytest.raises(ValueError, match=f"unit 'x' has factor {factor}, offset {offset}; expected numbers, no factor"):
        defined_unit("x", {"m": 1}, factor, offset)

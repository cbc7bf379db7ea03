"""Units and their factors: by the keys of a file, and in one module alone."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import numpy as np
import pytest

from inkloop import units
from inkloop.tables.messages import other_unit
from inkloop.units import QUANTITIES, SUFFIXES, UNITS, declared_key, defined_unit, key_of
from support.places import ROOT
from support.source_tree import parsed

INCH = defined_unit("inch", {"m": 1}, 0.0254, 0.0)


@pytest.mark.parametrize(
    ("unit", "key", "declared"),
    [
        ("m", ("x_um", "um", 1e-6), ("x_m", "m", 1.0)),
        ("mm", ("x_um", "um", 1e-3), ("x_mm", "mm", 1.0)),
        (INCH, ("x_um", "um", 1e-6 / 0.0254), ("x_um", "um", 1e-6 / 0.0254)),
        ("1/m", ("x_per_um", "1/um", 1e6), ("x_per_m", "1/m", 1.0)),
        ("m/s", ("x_um_per_s", "um/s", 1e-6), ("x_m_per_s", "m/s", 1.0)),
        ("s", ("x_s", "s", 1.0), ("x_s", "s", 1.0)),
        ("m3", ("x_pl", "pl", 1e-15), ("x_m3", "m3", 1.0)),
        ("V", ("x", "V", 1.0), ("x", "V", 1.0)),
        ("1", ("x", "1", 1.0), ("x", "1", 1.0)),
    ],
)
def test_quantity_has_one_key_with_its_unit(unit: str, key: tuple[object, ...], declared: tuple[object, ...]) -> None:
    """In a scenario the unit of the quantity, of a parameter in a file of an FMU the one that it declares."""
    assert key_of("x", unit) == key
    assert declared_key("x", unit) == declared


@pytest.mark.parametrize(
    ("key", "value", "error"),
    [
        ("pitch_mm", 0.3, "pitch_mm is in mm; write pitch_um = 300"),
        ("pitch_mm", [[0.1, 2], [3, 4]], "pitch_mm is in mm; write pitch_um = [[100, 2000],\n [3000, 4000]]"),
        ("pitch_mm", "wide", "pitch_mm is in mm; write pitch_um"),
        ("pitch", 250, "pitch is a length; write pitch_um"),
        ("cure_s", 0.1, "cure_s is in s; write cure_ms = 100"),
        ("gain_per_mm", 4.0, "gain_per_mm is in 1/mm; write gain_per_um = 0.004"),
        ("pitch_ms", 1.0, None),
        ("share", 1.0, None),
        ("pich_um", 1.0, None),
    ],
)
def test_other_unit_is_answered_with_the_key_and_the_converted_value(key: str, value: object, error: str) -> None:
    assert other_unit(key, value, ("pitch_um", "cure_ms", "gain_per_um", "share_min", "alpha")) == error


FACTORS = {10.0**exponent for exponent in (-18, -15, -12, -9, -6, -3, 3, 6, 9, 12, 15, 18)}
UNIT_NAMES = {suffix for suffixes in SUFFIXES.values() for suffix in suffixes}
OPERATORS = (ast.Mult, ast.Div, ast.FloorDiv)
NO_FACTORS = {
    "cosim/inkloop/scenario/part_grid.py": "CLOSE is a share, SECONDS_OF_A_CELL a speed",
    "cosim/inkloop/tables/part_mesh.py": "ROUNDED is a share",
    "cosim/inkloop/geometry/mesh.py": "OPEN_MAX is a share of columns",
    "lab/inkloop_lab/identify/droplet_volume.py": "SINGULAR is a share of an information",
    "lab/inkloop_lab/identify/expected_increments.py": "the share of a width below which a variance is rounding",
    "lab/inkloop_lab/identify/ink_regression.py": "PERTURBATION is a share of a layer",
    "cosim/inkloop/results/solid.py": "STEP_M is the height of a voxel",
    "lab/inkloop_lab/reproduce/finite_elements.py": "tolerances of a solver and of an area",
    "cosim/inkloop/tables/slices.py": "EDGE is a share of a pitch",
    "hardware/inkloop_hardware/mapped/mapped_bus.py": "the share by which a reading may differ",
    "hardware/inkloop_hardware/protocol/codec.py": "the share of a step that is rounding",
}
"""Modules with such numbers that convert nothing, and what the numbers are."""


def is_factor(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.value in FACTORS


def own_factors(tree: ast.Module) -> Iterator[int]:
    """Lines on which a module multiplies or divides by a power of 1000, written there or bound to a name of its own.

    A row with the name of a unit and such a number, in a table, counts too.
    """
    bound: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            values = node.value.elts if isinstance(node.value, ast.Tuple) else [node.value]
            names = node.targets[0].elts if isinstance(node.targets[0], ast.Tuple) else node.targets[:1]
            bound |= {ast.unparse(name) for name, value in zip(names, values, strict=False) if is_factor(value)}
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, OPERATORS):
            if any(is_factor(side) or (bound and ast.unparse(side) in bound) for side in (node.left, node.right)):
                yield node.lineno
        elif isinstance(node, ast.Dict):
            rows = zip(node.keys, node.values, strict=True)
            yield from (value.lineno for key, value in rows if key and is_row(key, value))
        elif isinstance(node, ast.Tuple) and len(node.elts) == 2 and is_row(*node.elts):
            yield node.lineno


def is_row(key: ast.expr, value: ast.expr) -> bool:
    """A text whose last word is a unit, with a factor."""
    text = key.value if isinstance(key, ast.Constant) and isinstance(key.value, str) else ""
    return text.split(" ")[-1] in UNIT_NAMES and is_factor(value)


def test_factors_between_units_stand_in_one_module() -> None:
    folders = ("cosim", "controller", "hardware", "lab", "tools", "benchmarks")
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    found = {path.relative_to(ROOT).as_posix(): sorted(set(own_factors(parsed(path)))) for path in paths}
    assert found.pop("cosim/inkloop/units.py")
    assert {name: lines for name, lines in found.items() if lines and name not in NO_FACTORS} == {}
    assert [name for name in NO_FACTORS if not found[name]] == []


def test_factors_of_both_directions_agree() -> None:
    """Both are written out: a product with one and a quotient by the other differ in the last bit."""
    for one, other in (
        (units.UM_PER_M, units.M_PER_UM),
        (units.NS_PER_S, units.S_PER_NS),
        (units.MS_PER_S, units.S_PER_MS),
    ):
        assert one * other == pytest.approx(1.0, rel=1e-15, abs=0.0)
    assert {units.M_PER_UM, 1.0 / units.MM_PER_M, 1.0 / units.NM_PER_M} < set(SUFFIXES["m"].values())
    assert {1.0 / units.MS_PER_S, 1.0 / units.US_PER_S} < set(SUFFIXES["s"].values())
    assert SUFFIXES["m3"]["pl"] == 1.0 / units.PL_PER_M3
    lengths = units.LENGTHS
    assert lengths["ft"] == pytest.approx(12 * lengths["in"], rel=1e-15, abs=0.0)
    assert lengths["in"] == pytest.approx(2.54 * lengths["cm"], rel=1e-15, abs=0.0)
    assert lengths["in"] == units.M_PER_INCH


def test_units_are_written_as_in_fmi_and_known_by_their_size() -> None:
    """Sizes by the prefixes of SI; a litre is 1e-3 m3, a turn 360 deg."""
    prefix = {"u": 1e-6, "m": 1e-3, "n": 1e-9}
    expected = {"m": ("m", 1.0), "s": ("s", 1.0), "rad": ("rad", 1.0), "min": ("s", 60.0), "deg": ("rad", np.pi / 180)}
    expected |= {f"{letter}m": ("m", size) for letter, size in prefix.items()}
    expected |= {f"1/{letter}m": ("1/m", 1.0 / prefix[letter]) for letter in "um"} | {"1/m": ("1/m", 1.0)}
    expected |= {f"{letter}m/s": ("m/s", prefix[letter]) for letter in "um"} | {"m/s": ("m/s", 1.0)}
    for power in (2, 3):
        expected |= {f"{letter}m{power}": (f"m{power}", prefix[letter] ** power) for letter in "um"}
        expected[f"m{power}"] = (f"m{power}", 1.0)
    expected |= {"pl": ("m3", 1e-12 * 1e-3), "nl": ("m3", 1e-9 * 1e-3), "mrad": ("rad", 1e-3)}
    expected |= {"ms": ("s", 1e-3), "us": ("s", 1e-6)}
    assert set(UNITS) == set(expected)
    for unit, (si, factor) in expected.items():
        assert UNITS[unit] == (si, pytest.approx(factor, rel=1e-12, abs=0.0)), unit


@pytest.mark.parametrize(
    ("line", "converts"),
    [
        ("x = f'{y * 1e3:g} ms'", True),
        ("UM = 1e-6\nx = y / UM", True),
        ("MS, S = 1000, 1\nx = y // MS", True),
        ("x = {'um': 1e-6}", True),
        ("x = ('time, ms', 1e3)", True),
        ("LIMIT_M = 1e-9\nx = y < LIMIT_M", False),
        ("x = {'side': 1000}", False),
    ],
)
def test_factors_are_told_from_tolerances_and_sizes(line: str, converts: bool) -> None:
    assert bool(list(own_factors(ast.parse(line)))) == converts


def test_exponents_of_the_base_units_are_those_that_the_name_of_the_unit_shows() -> None:
    assert set(QUANTITIES) == set(SUFFIXES) == set(units.BASE_UNITS) - {"1"}
    for name, exponents in units.BASE_UNITS.items():
        above, _, below = name.partition("/")
        shown = {part.rstrip("23"): sign * int(part.lstrip("mrads") or 1)
                 for part, sign in ((above, 1), (below, -1)) if part not in ("", "1")}  # fmt: skip
        assert exponents == shown, name

"""The table of parameters: names and units of the standards, and which of them are evaluated."""

from __future__ import annotations

import math

import numpy as np
import pytest

from inkloop.metrology.evaluation.definitions import DEFINITIONS, Evaluation, Treatment, symbols
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.table import Parameter, evaluate, parameters, rows
from support.evaluated import STEP, map_of, rough


def test_symbols_have_the_names_and_units_of_the_standards() -> None:
    assert (DEFINITIONS["Sa"].name, DEFINITIONS["Spk"].name) == ("arithmetical mean height", "reduced peak height")
    ratios = {symbol for symbol, each in DEFINITIONS.items() if each.unit == "1"}
    assert ratios == {"Ssk", "Sku", "Sdq", "Sdr", "Smr1", "Smr2", "Str", "droplets", "Psk", "Pku", "Rsk", "Rku"}
    assert all(DEFINITIONS[symbol].shown == "1" for symbol in ratios)
    angles = {symbol for symbol, each in DEFINITIONS.items() if each.unit == "rad"}
    assert angles == {"Std", "wall_angle_ls", "wall_angle_mz"}
    assert {symbol: DEFINITIONS[symbol].shown for symbol in symbols("volume")} == {
        "volume_printed": "nl", "volume_target": "nl", "volume_error": "nl", "droplets": "1", "droplet_volume": "pl",
    }  # fmt: skip
    common = ("t", "sk", "ku", "sm")
    primary, roughness = (f"P{key}" for key in ("a", "q", "p", "v", *common)), ("a", "q", "p", "v", "z", *common)
    assert symbols("profile") == (*primary, *(f"R{key}" for key in roughness))
    assert DEFINITIONS["Rp"].name == "mean peak height of the roughness profile"
    assert DEFINITIONS["Pv"].name == "pit depth of the primary profile"
    for symbol, each in DEFINITIONS.items():
        if symbol.endswith(("_ls", "_mz")):
            assert each.name.endswith("least squares" if symbol.endswith("_ls") else "minimum zone")
            assert each.name.startswith(symbol[:-3].replace("_", " "))


@pytest.mark.parametrize(
    ("symbol", "value", "key", "shown"),
    [
        ("Sa", 2e-6, "Sa_um", 2.0),
        ("Ssk", 0.5, "Ssk", 0.5),
        ("Std", math.pi / 6, "Std_deg", 30.0),
        ("volume_error", -3e-12, "volume_error_nl", -3.0),
        ("droplet_volume", 5e-14, "droplet_volume_pl", 50.0),
    ],
)
def test_parameter_is_shown_in_the_unit_of_its_key(symbol: str, value: float, key: str, shown: float) -> None:
    found = Parameter(symbol, DEFINITIONS[symbol].name, value, DEFINITIONS[symbol].unit)
    assert found.key == key
    assert found.shown == pytest.approx(shown, rel=1e-9, abs=0.0)


def test_units_are_printed_as_people_write_them() -> None:
    symbols_ = ("Sa", "Ssk", "Std", "volume_error", "droplet_volume", "droplets")
    found = [Parameter(symbol, "", 1.0, DEFINITIONS[symbol].unit).printed_unit for symbol in symbols_]
    assert found == ["µm", "", "°", "nl", "pl", ""]


def test_only_what_is_wanted_is_evaluated_in_the_order_of_the_definitions() -> None:
    z = rough((60, 17))
    subject = Subject(map_of(z), droplets=40)
    found = evaluate(subject, Evaluation(("droplets", "Pq", "Sq"), Treatment("none"), axis="x"))
    assert [row.symbol for row in found] == ["Sq", "Pq", "droplets"]
    values = {row.symbol: row.value for row in found}
    assert values["Sq"] == pytest.approx(z.std(), rel=1e-9, abs=0.0)
    centred = z - z.mean(axis=0)
    assert values["Pq"] == pytest.approx(np.sqrt((centred**2).mean(axis=0)).mean(), rel=1e-9, abs=0.0)
    assert values["droplets"] == 40.0
    assert evaluate(subject, Evaluation(("Pq",))) == ()  # along no axis
    assert [row.symbol for row in rows({"Sq": 1.0, "Sa": 2.0}, ("Sq",))] == ["Sq"]


def test_parameters_of_an_array_are_those_of_its_groups() -> None:
    z = rough((24, 17))
    target = np.zeros_like(z)
    assert {row.symbol for row in parameters(z, None, STEP)} == set(symbols("areal"))
    both = parameters(z, None, STEP, groups=("areal", "volume"), target=target, start=target, droplets=7)
    values = {row.symbol: row.value for row in both}
    assert values["volume_printed"] == pytest.approx(z.sum() * STEP**2, rel=1e-9, abs=0.0)
    assert values["volume_error"] == pytest.approx(-z.sum() * STEP**2, rel=1e-9, abs=0.0)
    assert values["droplet_volume"] == pytest.approx(z.sum() * STEP**2 / 7, rel=1e-9, abs=0.0)
    refused = {row.symbol: row for row in parameters(z[:5, :5], None, STEP)}
    assert math.isnan(refused["Sq"].value)
    assert refused["Sq"].reason.startswith("25 cells have a height")

"""The schema for editors takes what `inkloop` takes, and refuses what it can recognise as wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import tomlkit
from jsonschema import Draft7Validator

from inkloop.cli import main
from inkloop.components import catalog
from inkloop.scenario import new
from inkloop.scenario.json_schema import scenario_schema
from inkloop.testing import job as small_job
from support.places import SCENARIOS

FOLDER = SCENARIOS
SCHEMA = scenario_schema()


def errors(document: Any) -> list[str]:
    return [f"{list(error.absolute_path)}: {error.message}" for error in Draft7Validator(SCHEMA).iter_errors(document)]


def cuboid() -> Any:
    return tomlkit.parse((FOLDER / "cuboid.toml").read_text()).unwrap()


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [
        ("grid", "nz", 3),
        ("grid", "nx", "35"),
        ("part", "shape", "cone"),
        ("controller", "kind", "LayerMcp"),
        ("controller", "alpha", "much"),
        ("printer", "layer_duration", 5.0),
        ("profiler", "preset", "lasr"),
    ],
)
def test_wrong_key_or_value_does_not_fit_the_schema(table: str, key: str, value: object) -> None:
    document = cuboid()
    tables = document | document["components"]
    tables[table][key] = value
    assert len(errors(document)) >= 1


def test_every_option_of_the_python_kinds_is_in_the_schema() -> None:
    rules = SCHEMA["$defs"]["ComponentTable"]["allOf"]
    known = {rule["if"]["properties"]["kind"]["const"]: rule["then"]["properties"] for rule in rules}
    for kind, python in catalog.PYTHON_KINDS.items():
        assert set(python.options_table().model_fields) <= set(known[kind])


def test_option_without_a_default_is_required_and_a_map_is_a_list_of_rows() -> None:
    document = cuboid()
    for profiler, is_whole in (({"folder": "scans"}, True), ({}, False)):
        document["components"]["profiler"] = {"kind": "MapFolder", **profiler}
        assert (errors(document) == []) == is_whole
    document = cuboid()
    for value, fits in (([[1.0, 2.0], [3.0, 4.0]], True), (5.0, True), ([1.0, 2.0], False), ([[[1.0]]], False)):
        document["components"]["printer"]["height_start_um"] = value
        assert (errors(document) == []) == fits, value


def test_command_writes_the_schema_or_prints_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", "schema"]) == 0
    assert json.loads(capsys.readouterr().out) == SCHEMA
    assert main(["export", "schema", "--out", str(tmp_path / "schema.json")]) == 0
    assert json.loads((tmp_path / "schema.json").read_text()) == SCHEMA


def test_device_has_the_options_of_its_model_and_no_others() -> None:
    document = cuboid()
    document["components"]["profiler"] = {"kind": "hardware.profiler"}
    for key, expected in {"drift_rate_um": 0, "drift_raet_um": 1}.items():
        document["components"]["profiler"] = {"kind": "hardware.profiler", key: 1.0}
        assert len(errors(document)) == expected, key


@pytest.mark.parametrize(
    ("key", "values", "others"),
    [
        ("variation_kind", ["per_droplet", 1, "per_cell", 2], ["per_drop", 0, 9, 1.5]),
        ("passes", [1, 4], [0, 5, 1.5, "one"]),
        ("variation", [0.0, 1.0], [-0.001, 1.001, "0.2"]),
        ("h1_a_um", [1e-3, 50.0], [-1.0, "4.4"]),
        ("layer_duration_s", [0.0, 5.0], [-1.0, True]),
        ("seed", [0, 7], [-1, 0.5]),
        ("fmi", ["fmi2", "fmi3", "fmi3-fixed"], ["fmi1", 2]),
    ],
)
def test_option_of_a_model_takes_what_its_variable_takes(key: str, values: list[Any], others: list[Any]) -> None:
    """The schema and the reader of scenarios, which share no code for it, agree on every value."""
    for value in (*values, *others):
        document = cuboid()
        document["components"]["printer"][key] = value
        checked = catalog.check("LayerDeposition", small_job(12, 12), {key: value})
        assert bool(errors(document)) == bool(checked.errors) == (value in others and value not in values), value


def test_schema_takes_shipped_scenarios_templates_and_any_option_of_a_users_kind(tmp_path: Path) -> None:
    Draft7Validator.check_schema(SCHEMA)
    templates = [new.write(tmp_path / shape, shape) for shape in new.shapes()]
    for path in (*sorted(FOLDER.glob("*.toml")), *templates):
        assert errors(tomlkit.parse(path.read_text()).unwrap()) == [], path
    document = cuboid()
    document["components"]["controller"] = {"kind": "mine:Controller", "threshold": [1, 2]}
    assert errors(document) == []

"""Exporting FMUs: grids, tokens and messages where it is impossible."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Literal

import fmpy
import numpy as np
import pytest

from inkloop.errors import ComponentError, FmuError
from inkloop.fmu import FmuComponent, describe
from inkloop.fmu_writer import c_tables, definition, export
from inkloop.fmu_writer.archive import pack, unpack
from inkloop.fmu_writer.export import export_fmu, find_fmu
from support.places import ROOT

DEFINITION = ROOT / "fmus" / "layer_deposition" / "variables.toml"


def test_structural_fmu_starts_with_the_exported_grid(tmp_path) -> None:
    path = export_fmu("LayerDeposition", fmi="3", nx=5, ny=7, fixed=False, out=tmp_path / "it.fmu")
    result = fmpy.simulate_fmu(str(path), start_values={"layer_period": 1.0}, output_interval=1.0, stop_time=2.0)
    assert np.asarray(result["height"][-1]).shape == (5, 7)


@pytest.mark.parametrize("fmi", ["2", "3"])
def test_fixed_fmu_has_as_many_cells_as_asked_for(fmi, tmp_path) -> None:
    path = export_fmu("LayerDeposition", fmi=fmi, nx=3, ny=2, fixed=True, out=tmp_path / "sub" / "it.fmu")
    description = fmpy.read_model_description(str(path))
    found = {v.name: v for v in description.modelVariables}
    if fmi == "2":
        assert [name for name in found if name.startswith("height[")] == [
            f"height[{i},{j}]" for i in (1, 2, 3) for j in (1, 2)
        ]
        assert found["nx"].start == "3"
    else:
        assert [d.start for d in found["height"].dimensions] == [3, 2]


def test_fmi_2_grid_that_many_tools_cannot_read_is_refused_unless_forced(tmp_path, monkeypatch) -> None:
    out = tmp_path / "it.fmu"
    message = r"400 x 400 cells has a modelDescription\.xml of about 175 MiB.* 2\.98 GiB .*use FMI 3.*--force"
    with pytest.raises(FmuError, match=message):
        export_fmu("ProfileSensor", fmi="2", nx=400, ny=400, out=out)
    assert not out.exists()
    monkeypatch.setattr(export, "FMI2_CELLS_MAX", 9)
    with pytest.raises(FmuError, match="5 x 2 cells has"):
        export_fmu("ProfileSensor", fmi="2", nx=5, ny=2, out=out)
    assert export_fmu("ProfileSensor", fmi="2", nx=3, ny=3, out=out) == out
    assert export_fmu("ProfileSensor", fmi="2", nx=5, ny=2, out=out, force=True) == out


def test_fingerprint_changes_with_what_the_binary_must_know() -> None:
    text = DEFINITION.read_text()
    model = definition.load(text, DEFINITION)
    same = definition.load(text.replace("Simulation time", "Time"), DEFINITION)
    other = definition.load(text.replace("max = 2, terminal", "max = 3, terminal"), DEFINITION)
    assert model.fingerprint == same.fingerprint != other.fingerprint
    assert model.token({"nx": 4, "ny": 5}, resizable=False) == f"LayerDeposition-{model.fingerprint}-4x5"


def test_emulator_has_parameters_by_name_limits_and_start(tmp_path) -> None:
    model = definition.load(DEFINITION.read_text(), DEFINITION)
    changed: dict[str, Any] = {"nozzle_variation": {"start": 0.25, "min": 0.125}}
    model = replace(model, variables=tuple(replace(v, **changed.get(v.name, {})) for v in model.variables))
    header = c_tables.emulated_parameters([model])
    assert '{"nozzle_variation", REAL, WORLD(variation.nozzle_variation), 0.125, 1.0}' in header
    assert ".variation.nozzle_variation = 0.25" in header
    assert "roller_step" not in header


def test_files_to_be_compiled_are_the_c_files_of_the_archive(tmp_path) -> None:
    members = unpack(export_fmu("LayerDeposition", fmi="2", nx=3, ny=3, out=tmp_path / "it.fmu"))
    listed = re.findall(r'<File name="([^"]+)"', members["modelDescription.xml"].decode())
    assert sorted(listed) == sorted(name.removeprefix("sources/") for name in members if name.endswith(".c"))
    assert "sources/layer_map.h" in members


def test_set_that_is_missing_damaged_or_of_another_build_is_named_with_a_remedy(tmp_path, monkeypatch) -> None:
    fmi: Literal["2", "3"]
    with pytest.raises(FmuError, match="'fmi1'; expected one of fmi3, fmi3-fixed, fmi2"):
        find_fmu("LayerDeposition", "fmi1")
    members = unpack(find_fmu("LayerDeposition", "fmi2"))
    fingerprint = definition.load(DEFINITION.read_text(), DEFINITION).fingerprint
    older = members["modelDescription.xml"].replace(fingerprint.encode(), b"0123456789abcdef")
    pack(tmp_path / "fmi2" / "LayerDeposition.fmu", {**members, "modelDescription.xml": older})
    with pytest.raises(ComponentError, match=r"this binary expects .*run make, .* then export it again"):
        FmuComponent(tmp_path / "fmi2" / "LayerDeposition.fmu").initialize(0, {})
    (tmp_path / "fmi3").mkdir()
    (tmp_path / "fmi3" / "LayerDeposition.fmu").write_text("no archive")
    monkeypatch.setenv("INKLOOP_FMU_DIR", str(tmp_path))
    for fmi, message in (
        ("2", "LayerDeposition: .* built from other sources .*; run make"),
        ("3", "is not a readable"),
    ):
        with pytest.raises(FmuError, match=message):
            export_fmu("LayerDeposition", fmi=fmi, nx=3, ny=3, out=tmp_path / "it.fmu")
    assert not (tmp_path / "it.fmu").exists()
    monkeypatch.setenv("INKLOOP_FMU_DIR", str(tmp_path / "none"))
    with pytest.raises(FmuError, match="models there: none"):
        find_fmu("LayerDeposition")


def test_every_error_of_a_definition_is_reported() -> None:
    text = DEFINITION.read_text()
    for old, new in (
        ('terminal = "command"', 'terminal = "nowhere"'),
        ('declared = "PassOrder", ', ""),
        ('initial_from = "layer_command"', 'initial_from = "gone"'),
        ('initial_from = "height_start", description', 'emulated = "h", description'),
        (
            'height_start = { causality = "parameter", shape = "grid"',
            'height_start = { causality = "parameter", shape = "grid", along = "nz"',
        ),
        ('seed = { causality = "parameter"', 'seed = { causality = "output"'),
    ):
        assert old in text, old
        text = text.replace(old, new)
    with pytest.raises(FmuError) as caught:
        definition.load(text, "it.toml")
    message = str(caught.value)
    assert message.startswith("it.toml: ")
    for part in (
        "pattern: terminal is 'nowhere'",
        "pass_order: declared is None",
        "layers_printed: initial_from is",
        "height: is emulated; only a scalar parameter of type real",
        "height_start: along is 'nz'; a grid may name a structural parameter after nx, ny",
        "variables must come in the order",
    ):
        assert part in message


SMALL = """model = "It"
description = "It"
step_size = 1.0
stop_time = 2.0
[types.Mode]
description = "Modes"
items = { off = 0, slow = 7, full = 3 }
[variables]
time = { causality = "independent", description = "t" }
nx = { causality = "structural", type = "count", start = 9, description = "x" }
ny = { causality = "structural", type = "count", start = 9, description = "y" }
nz = { causality = "structural", type = "count", start = 2, description = "z" }
tick = { causality = "input", type = "clock", description = "c" }
data = { causality = "input", type = "binary", max = 9, clock = "tick", description = "d" }
mode = { causality = "parameter", type = "enumeration", declared = "Mode", description = "m" }
name = { causality = "parameter", type = "string", max = 9, description = "n" }
gain = { causality = "parameter", min = -1.0, max = 4.0, is_tunable = true, description = "g" }
maps = { causality = "state", shape = "grid", along = "nz" }
"""


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ('"independent"', '"dependent"', "a causality is none of independent, structural, input, output, parameter"),
        ("nx = {", "nw = {", "the first variables must be time, nx, ny"),
        ("ny = {", "nw = {", "the first variables must be time, nx, ny"),
        ("tick =", 'n4 = { causality = "structural", type = "count", description = "4" }\ntick =',
         "structural parameters are nx, ny, nz, n4; at most one comes after nx, ny"),
        ('along = "nz"', 'along = "ny"', "maps: along is 'ny'; a grid may name a structural parameter after nx, ny"),
        ('shape = "grid", along', "along", "maps: along is 'nz'; a grid may name a structural parameter after nx, ny"),
        ('"input", type = "clock"', '"input", is_tunable = true, type = "clock"',
         "tick: is_tunable is true; only a parameter can be"),
        ('along = "nz"', 'along = "nz", emulated = "m"', "maps: is emulated; only a scalar parameter of type re"),
        ("max = 4.0,", 'max = 4.0, type = "float",', "gain: type is 'float'; expected one of real, integer, boolean"),
        (', description = "g"', "", "gain: has no description"),
        ('type = "enumeration", ', "", "mode: declared is 'Mode'; an enumeration names one of [types], others none"),
        ('"clock", ', '"clock", start = 1, ', "tick: is a clock; it is one value without a start value"),
        ('"string", ', '"string", shape = "grid", ', "name: is a string; it is one value without a start value"),
        ("max = 9, clock", "clock", "data: is a binary without max, its most bytes"),
        ("max = 9, description", "description", "name: is a string without max, its most bytes"),
        ('clock = "tick"', 'clock = "nx"', "data: clock is 'nx'; there is no such clock"),
        ("is_tunable", 'initial_from = "gains", is_tunable', "gain: initial_from is 'gains'; there is no such var"),
    ],
)  # fmt: skip
def test_error_of_a_definition_names_variable_finding_and_rule(old: str, new: str, error: str) -> None:
    assert SMALL.count(old) == 1
    with pytest.raises(FmuError) as caught:
        definition.load(SMALL.replace(old, new), "it.toml")
    first, only = str(caught.value).splitlines()
    assert first == "it.toml: 1 errors"
    assert only.startswith(f"  - {error}")


def test_limits_of_an_enumeration_are_those_of_its_numbers_and_a_clock_belongs_to_the_fingerprint() -> None:
    model = definition.load(SMALL, "it.toml")
    limits = {v.name: model.limits(v) for v in model.variables}
    assert (limits["mode"], limits["gain"], limits["tick"], limits["nx"]) == ((0, 7), (-1.0, 4.0), (0, 1), (None, None))
    assert model.fingerprint != definition.load(SMALL.replace(', clock = "tick"', ""), "it.toml").fingerprint
    assert model.token({"nx": 3, "ny": 2, "nz": 1}, resizable=True, mark="x").endswith("-3x2x1-resizable")
    assert model.token({"nx": 3, "ny": 2, "nz": 1}, resizable=False, mark="abc").endswith("-3x2x1-abc")


@pytest.mark.parametrize(
    ("fmi", "intervals", "bytes_", "remedy"),
    [
        ("3", None, 100 * 6, "choose a smaller grid"),
        ("3", 2, 100 * 6, "choose a smaller grid"),
        ("3", 8, 200 * 6, "choose a smaller grid"),  # twelve maps, and two for each of six further intervals
        ("2", 5, 30_000 * 6, "choose a smaller grid, or FMI 3, whose description does not grow with it"),
    ],
)
def test_memory_of_an_exported_fmu_counts_cells_and_intervals(
    fmi: Any, intervals: int | None, bytes_: int, remedy: str, tmp_path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen: dict[str, Any] = {"fmi": fmi, "nx": 3, "ny": 2, "intervals": intervals, "out": tmp_path / "it.fmu"}
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: bytes_ - 1)
    with pytest.raises(FmuError, match=rf"of 3 x 2 cells needs about .* for what reads and runs it; {remedy}$"):
        export_fmu("LayerController", **chosen)
    monkeypatch.setattr("inkloop.limits.available_memory", lambda: bytes_)
    monkeypatch.setattr(export, "find_fmu", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        export_fmu("LayerController", **chosen)


@pytest.mark.parametrize(("nx", "ny"), [(0, 2), (2, 0), (-1, 2)])
def test_grid_without_cells_is_refused(nx: int, ny: int, tmp_path) -> None:
    with pytest.raises(FmuError, match=f"the grid is {nx} x {ny} cells; expected at least 1 x 1"):
        export_fmu("LayerDeposition", nx=nx, ny=ny, out=tmp_path / "it.fmu")


def test_fmi_2_grid_that_takes_importers_minutes_is_told(tmp_path, monkeypatch, caplog) -> None:
    monkeypatch.setattr(export, "FMI2_CELLS", 6)
    export_fmu("ProfileSensor", fmi="2", nx=3, ny=2, out=tmp_path / "it.fmu")
    assert not caplog.records
    export_fmu("ProfileSensor", fmi="2", nx=7, ny=1, out=tmp_path / "it.fmu")
    assert "ProfileSensor as FMI 2 with 7 x 1 cells has 7 scalars per map" in caplog.text
    caplog.clear()
    export_fmu("ProfileSensor", fmi="3", nx=7, ny=1, out=tmp_path / "it.fmu")
    assert not caplog.records


def test_fmu_has_nine_by_nine_cells_of_fmi_3_where_nothing_is_chosen(tmp_path) -> None:
    found = describe(export_fmu("ProfileSensor", out=tmp_path / "it.fmu"))
    assert (found.grid, found.fmi, found.fixed_grid) == ((9, 9), 3, None)


def test_definition_takes_the_emulated_parameters_of_another_but_for_its_own(tmp_path) -> None:
    rows = {name: f'{name} = {{ start = 1.0, emulated = "w.{name}" }}' for name in ("gain", "gain_b", "noise")}
    for folder, lines in (
        ("base", ["[variables]", *rows.values(), "seed = { start = 2 }"]),
        ("bench", ["[variables]", 'base = "emulated"', "gain = { start = 3.0 }"]),
    ):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "variables.toml").write_text("\n".join(lines), encoding="utf-8")
    found = definition.text_of(tmp_path / "bench" / "variables.toml")
    assert found.splitlines() == ["[variables]", rows["gain_b"], rows["noise"], "gain = { start = 3.0 }"]

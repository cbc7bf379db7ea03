from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop.components import catalog, fmu_parameters
from inkloop.components.fmu_parameters import PRESETS
from inkloop.errors import ScenarioError
from inkloop.fmu import FmuDescription, Variable, describe
from inkloop.fmu_writer.export import INTERVALS, INTERVALS_MAX, find_fmu
from inkloop.geometry import Columns
from inkloop.scenario.file import Scenario
from support.fmus.amplifier import altered, build
from support.places import ROOT
from support.toys import toy_job

KINDS = {"per droplet": 1, "per_layer": 3}


def parameter(name: str, unit: str = "1", type: str = "Float64", **more: object) -> Variable:
    return Variable(name, type, "parameter", "fixed", (0,), unit=unit, start=("0",), **more)  # type: ignore[arg-type]


PRINTER = FmuDescription(
    path=Path("printer.fmu"),
    name="Printer",
    fmi=3,
    identifier="Printer",
    token="",
    variables={
        variable.name: variable
        for variable in (
            Variable("nx", "UInt64", "structuralParameter", "fixed", (1,), start=("9",)),
            Variable("ny", "UInt64", "structuralParameter", "fixed", (2,), start=("9",)),
            Variable("height", "Float64", "output", "discrete", (3,), ("nx", "ny"), "m"),
            parameter("pitch", "m"),
            parameter("h1_a", "m"),
            parameter("height_start", "m", dimensions=("nx", "ny")),
            parameter("variation", minimum="0", maximum="1", description="largest share missing"),
            parameter("variation_kind", type="Enumeration", items=KINDS),
            parameter("layer_duration", "s"),
            parameter("seed", type="Int32"),
        )
    },
    platforms=(),
    can_serialize=True,
    can_vary_step=True,
)


def parse(options: dict[str, object], job: Job | None = None) -> fmu_parameters.Parsed:
    return fmu_parameters.parse(PRINTER, job or toy_job(), options, ())


def test_job_gives_values_in_the_unit_of_the_fmu_and_no_foreign_ones() -> None:
    variables = {
        "pitch": parameter("pitch", "mm"),
        "h1_a": parameter("h1_a", "V"),
        "seed": parameter("seed", "kg"),
        "pass_order": parameter("pass_order"),
        "passes": parameter("passes", type="Int32"),
    }
    own = parse({}, job := toy_job(nx=6, ny=4))
    assert (own.errors, own.structural) == ([], {"nx": 6, "ny": 4})
    assert own.parameters == {"pitch": job.pitch, "h1_a": job.inks[0].h1, "seed": job.seed}
    sizes = {name: PRINTER.variables[name] for name in ("nx", "ny", "height")}
    foreign = replace(PRINTER, variables={**variables, **sizes})
    job = toy_job()
    assert fmu_parameters.parse(foreign, job, {}, ()).parameters == {"pitch": job.pitch * 1e3, "passes": 1}
    assert fmu_parameters.parse(foreign, job, {}, (), use_job_parameters=False).parameters == {}


def test_inks_and_ground_of_the_job_come_by_their_names_and_in_the_unit_of_the_fmu() -> None:
    names = [f"h{order}_{ink}" for ink in "ab" for order in (1, 2, 3)]
    lengths = {name: parameter(name, "mm") for name in names}
    printer = replace(PRINTER, variables=lengths | {"flat_ground": parameter("flat_ground", type="Boolean")})
    inks = Ink(5e-6, 0.5e-6, 0.25e-6), Ink(4e-6, 0.75e-6, 0.125e-6)
    job = replace(toy_job(), inks=inks)
    found = fmu_parameters.parse(printer, job, {}, ()).parameters
    expected = [5e-3, 0.5e-3, 0.25e-3, 4e-3, 0.75e-3, 0.125e-3]
    assert [found[name] for name in names] == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert found["flat_ground"] is True
    uneven = replace(job, height_start=np.zeros((job.nx, job.ny)))
    assert fmu_parameters.parse(printer, uneven, {}, ()).parameters["flat_ground"] is False


@pytest.mark.parametrize(
    ("nx", "ny", "sizes"), [(9, 4, {"ny": 4}), (6, 9, {"nx": 6}), (9, 9, {}), (6, 4, {"nx": 6, "ny": 4})]
)
def test_values_of_a_file_have_the_sizes_that_it_does_not_have(nx: int, ny: int, sizes: dict[str, int]) -> None:
    found = fmu_parameters.values_of_file(PRINTER, toy_job(nx=nx, ny=ny), {"variation": 0.5})
    assert {name: int(found[name]) for name in ("nx", "ny") if name in found} == sizes
    assert float(found["variation"]) == 0.5


def test_options_of_the_python_controller_have_their_names_in_the_fmu() -> None:
    assert fmu_parameters.options_of_controller_fmu({"sweeps": 3, "horizon": 2}) == {"sweeps_max": 3, "horizon": 2}


REGION = replace(
    PRINTER,
    variables={
        "nx": PRINTER.variables["nx"],
        "ny": PRINTER.variables["ny"],
        INTERVALS: Variable(INTERVALS, "UInt64", "structuralParameter", "fixed", (3,), start=("2",)),
        "height": PRINTER.variables["height"],
        "inks": parameter("inks", type="Int32"),
        "has_region": parameter("has_region", type="Boolean"),
        "region_bottom": parameter("region_bottom", "m", dimensions=(INTERVALS, "nx", "ny")),
        "region_top": parameter("region_top", "m", dimensions=(INTERVALS, "nx", "ny")),
    },
)


def heaps(count: int) -> Job:
    """A job whose ink A is `count` intervals over cell (0, 1)."""
    job = toy_job(nx=2, ny=3)
    bottoms = np.arange(count) * 2e-6
    region = Columns.of_intervals(2, 3, job.pitch, np.ones(count), bottoms, bottoms + 1e-6)
    return replace(job, inks=(Ink(), Ink()), region=region)


@pytest.mark.parametrize(
    ("count", "asked", "room"),
    [(1, None, 2), (2, None, 2), (3, None, 3), (INTERVALS_MAX, None, INTERVALS_MAX), (2, 2, 2), (2, 5, 5),
     (2, INTERVALS_MAX, INTERVALS_MAX)],
)  # fmt: skip
def test_fmu_has_room_for_the_intervals_of_the_region(count: int, asked: int | None, room: int) -> None:
    options: dict[str, object] = {} if asked is None else {INTERVALS: asked}
    parsed = fmu_parameters.parse(REGION, heaps(count), options, ())
    assert parsed.errors == []
    assert parsed.structural == {"nx": 2, "ny": 3, INTERVALS: room}
    assert (parsed.parameters["inks"], parsed.parameters["has_region"]) == (2, True)
    bottom, top = (parsed.values[f"region_{end}"] for end in ("bottom", "top"))
    assert bottom.shape == top.shape == (room, 2, 3)
    assert (bottom[:count, 0, 1] < top[:count, 0, 1]).all()
    assert (bottom < top).sum() == count


@pytest.mark.parametrize(
    ("count", "asked", "message"),
    [
        (3, 2, "room for 2 (region_intervals); leave region_intervals out"),
        (INTERVALS_MAX + 1, None, f"room for {INTERVALS_MAX} (region_intervals); take 'LayerMpc'"),
        (2, INTERVALS_MAX + 1, f"region_intervals is {INTERVALS_MAX + 1}; expected 1 to {INTERVALS_MAX}"),
    ],
)
def test_region_of_more_intervals_than_an_fmu_has_is_refused(count: int, asked: int | None, message: str) -> None:
    options: dict[str, object] = {} if asked is None else {INTERVALS: asked}
    assert message in fmu_parameters.parse(REGION, heaps(count), options, ()).errors[0]


def test_value_of_the_job_that_the_fmu_cannot_take_is_an_error() -> None:
    variables = {
        "passes": parameter("passes", type="Int32", maximum="1"),
        "pitch": parameter("pitch", "m", maximum="1e-6"),
    }
    parsed = fmu_parameters.parse(replace(PRINTER, variables=variables), toy_job(), {}, ())
    assert parsed.errors == ["kind: pitch is 0.0001; expected a number <= 1e-6 [m]; the job gives it, not this table"]


def test_option_overrules_the_job_and_comes_in_its_unit() -> None:
    for kind in ("per_layer", "per droplet", 3):
        parsed = parse({"pitch_um": 250, "nx": 5, "layer_duration_s": 1.5, "variation": 0.2, "variation_kind": kind})
        assert parsed.errors == []
    assert parsed.parameters["pitch"] == pytest.approx(250e-6, rel=1e-9, abs=0.0)
    assert parsed.parameters["layer_duration"] == 1.5
    assert parsed.parameters["variation"] == 0.2
    assert parsed.structural["nx"] == 5


def test_nested_list_fills_an_array_of_the_grid() -> None:
    job = toy_job(nx=2, ny=3)
    parsed = parse({"height_start_um": [[0, 1, 2], [3, 4, 5]]}, job)
    assert parsed.errors == []
    np.testing.assert_allclose(parsed.parameters["height_start"], np.arange(6).reshape(2, 3) * 1e-6)  # type: ignore[call-overload]
    (error,) = parse({"height_start_um": [[0, 1]]}, job).errors
    assert error.startswith("height_start_um is 1 x 2 values")
    assert error.endswith("expected a number, or 2 x 3 of them [um]")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"pitch": 1e-4}, "pitch is a length; write pitch_um"),
        ({"pich_um": 1.0}, "pich_um is no option of Printer; did you mean pitch_um?"),
        ({"variation": 2}, "variation is 2; expected a number in 0 .. 1 (largest share missing)"),
        (
            {"variation_kind": "per_cell"},
            "variation_kind is 'per_cell'; expected one of 'per droplet' (1), 'per_layer' (3)",
        ),
        ({"seed": 1.5}, "seed is 1.5; expected a whole number"),
        ({"pitch_mm": 0.25}, "pitch_mm is in mm; write pitch_um = 250"),
        ({"pitch_um": "wide"}, "pitch_um is 'wide'; expected a number [um]"),
        ({"nx": "many"}, "nx is 'many'; expected a whole number"),
    ],
)
def test_wrong_option_is_named_with_what_would_be_right(options: dict[str, object], message: str) -> None:
    assert parse(options).errors == [message]


@pytest.mark.compiled
def test_fmu_of_frames_and_clocks_alone_is_refused_before_it_runs(tmp_path: Path) -> None:
    fmu = altered(
        build(tmp_path, 3),
        tmp_path / "bus.fmu",
        ('<Float64 name="x"', '<Clock name="tx_clock" valueReference="50" causality="output" '
         'intervalVariability="triggered"/><Binary name="tx" valueReference="51" causality="output" clocks="50"/>'
         '<Float64 name="x"'),
        *((f'name="{name}" valueReference="{number}" causality="{causality}"',
           f'name="{name}" valueReference="{number}" causality="local"')
          for name, number, causality in (("on", 3, "input"), ("count", 6, "output"), ("x", 100, "input"),
                                          ("y", 200, "output"), ("high", 300, "output"))),
    )  # fmt: skip
    (error,) = catalog.check("Fmu", toy_job(), {"file": str(fmu)}).errors
    assert error.startswith("file is 'bus.fmu', whose inputs and outputs are of type Binary, Clock; this master")


@pytest.mark.compiled
def test_clocks_and_frames_beside_plain_outputs_are_a_warning(tmp_path: Path) -> None:
    plain = build(tmp_path, 3)
    clock = '<Clock name="tick" valueReference="50" causality="output" intervalVariability="triggered"/>'
    frame = '<Binary name="tx" valueReference="51" causality="output" clocks="50"/>'
    fmu = altered(plain, tmp_path / "bus.fmu", ('<Float64 name="x"', f'{clock}{frame}<Float64 name="x"'))
    found = {path: catalog.check("Fmu", toy_job(), {"file": str(path)}) for path in (plain, fmu)}
    assert [list(each.errors) for each in found.values()] == [[], []]
    assert found[plain].notes == []
    (note,) = found[fmu].notes
    assert "tick (Clock output) and 1 more of bus.fmu are not exchanged" in note
    text = (ROOT / "scenarios/cuboid.toml").read_text(encoding="utf-8")
    text += f'\n[components.odd]\nkind = "Fmu"\nfile = "{fmu}"\nports.x2 = "x"\n'
    warnings = Scenario.of_text(text, str(tmp_path / "it.toml")).warnings
    assert f"components.odd: {note}" in warnings


@pytest.mark.compiled
def test_fmu_of_one_instance_a_process_stands_once_in_a_loop(tmp_path: Path) -> None:
    single = ('modelIdentifier="amplifier"', 'modelIdentifier="amplifier" canBeInstantiatedOnlyOncePerProcess="true"')
    lone = altered(build(tmp_path, 3), tmp_path / "lone.fmu", single)
    (tmp_path / "folder").mkdir()
    for kind, plant in (("Fmu", {}), ("PlainPlant", {}), ("Shadow", {"plant": "Fmu"})):
        ports = {} if kind == "Fmu" else {"pattern_input": "x", "height_output": "y"}
        checked = catalog.check(kind, toy_job(nx=3, ny=1), {"file": str(lone), **plant, **ports})
        assert (checked.errors, checked.single) == ((), lone)
    free, same = tmp_path / "amplifier3.fmu", tmp_path / "folder" / ".." / "lone.fmu"
    files = {"one": lone, "two": same, "free": free, "free_too": free}
    tables = {name: {"kind": "Fmu", "file": str(path)} for name, path in files.items()}
    text = (ROOT / "scenarios/cuboid.toml").read_text(encoding="utf-8")
    for name, table in tables.items():
        text += f'\n[components.{name}]\nkind = "Fmu"\nfile = "{table["file"]}"\n'
    (tmp_path / "two.toml").write_text(text, encoding="utf-8")
    with pytest.raises(ScenarioError) as told:
        Scenario.load(tmp_path / "two.toml")
    named = [error for error in told.value.errors if "once per process" in error]
    assert named == [
        "components.two: lone.fmu can be instantiated once per process, and components.one has it; take it out, or "
        "export it without canBeInstantiatedOnlyOncePerProcess"
    ]


@pytest.mark.compiled
def test_damaged_file_is_an_error_before_anything_runs(tmp_path: Path) -> None:
    path = build(tmp_path, 3)
    content = bytearray(path.read_bytes())
    content[content.index(b"\x7fELF") + 40] ^= 0xFF
    path.write_bytes(bytes(content))
    (error,) = catalog.check("Fmu", toy_job(), {"file": str(path)}).errors
    assert error.startswith(f"file is {str(path)!r}, which cannot be unpacked, it is damaged: bad CRC-32 of binaries/")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": [[1, 0.8], [4, 0.3]]}, "alpha is a schedule; .* take kind 'LayerMpc' .* sets alpha between steps"),
        ({"sweeps": 3}, "sweeps is no option of LayerController; write sweeps_max"),
        ({"dead_nozzles": [1]}, "dead_nozzles is no option of .*; mark the cells that nozzles reach in jettable"),
        ({"device": "gpu"}, "device is no option of .*; it plans on the processor; leave it out, or .* 'LayerMpc'"),
        ({"certified": True}, "certified is no option of .*; it proves no bound; take kind 'LayerMpc' for one"),
        ({"foo": 1}, "foo is no option of LayerController; known: .* fringe_weight, h1_a_um, h1_b_um, h2_a_um, .*"),
    ],
)
def test_what_only_the_python_controller_takes_is_answered_with_what_to_do(
    options: dict[str, object], message: str
) -> None:
    (error,) = catalog.check("LayerController", toy_job(), options).errors
    assert re.fullmatch(message, error)


def test_fmu_of_a_file_names_what_is_wrong_with_the_job_s_parameters() -> None:
    options = {"file": str(find_fmu("ProfileSensor", "fmi3"))}
    assert not catalog.check("Fmu", toy_job(), options).errors
    for asked in (True, False):
        assert not catalog.check("Fmu", toy_job(), options | {"job_parameters": asked}).errors
        given = fmu_parameters.parse_file(
            describe(find_fmu("ProfileSensor", "fmi3")), toy_job(), {"job_parameters": asked}
        )
        assert ("seed" in given.parameters) == asked
    unasked = fmu_parameters.parse_file(describe(find_fmu("ProfileSensor", "fmi3")), toy_job(), {})
    assert "seed" in unasked.parameters
    found = catalog.check("Fmu", toy_job(), options | {"job_parameters": "no", "noise_std_m": -1.0}).errors
    assert found[0] == "job_parameters is 'no'; expected true or false"
    assert found[1].startswith("noise_std_m is -1")
    (found,) = catalog.check("Fmu", toy_job(), options | {"noise_std_um": 2.0}).errors
    assert found == "noise_std_um is in um; write noise_std_m = 2e-06"
    assert list(catalog.check("Fmu", toy_job(), {}).errors) == ["file is missing; name the .fmu file"]


def test_parameters_of_every_preset_are_parameters_of_its_model() -> None:
    for model, presets in PRESETS.items():
        known = describe(find_fmu(model, "fmi3")).parameters
        for values in presets.values():
            assert set(values) <= set(known)


def test_preset_gives_its_values_and_the_table_wins_over_them() -> None:
    options = {"preset": "laser", "noise_std_um": 3.0}
    parameters = fmu_parameters.parse_model("ProfileSensor", toy_job(), options).parameters
    assert parameters["noise_std"] == pytest.approx(3e-6, rel=1e-9, abs=0.0)
    assert parameters["resolution"] == PRESETS["ProfileSensor"]["laser"]["resolution"]


def test_presets_have_the_numbers_of_their_sources() -> None:
    """Lu, Zheng, Mishra 2015, Fig. 17; Wu, Chiu 2024."""
    expected = {
        "laser": {"noise_std": 1e-6, "resolution": 0.1e-6, "scan_duration": 6.0},
        "zeta-20": {"resolution": 0.04e-6, "scan_duration": 6.0},
        "exact": {"scan_duration": 0.0},
    }
    assert {"ProfileSensor": expected} == PRESETS


@pytest.mark.parametrize(
    ("kind", "preset", "message"),
    [
        ("ProfileSensor", "lasr", "preset is 'lasr'; expected one of laser, zeta-20, exact"),
        ("ProfileSensor", 3, "preset is 3; expected one of laser, zeta-20, exact"),
        ("LayerDeposition", "laser", "preset is 'laser'; LayerDeposition has no presets"),
    ],
)
def test_preset_that_there_is_not_is_an_error(kind: str, preset: object, message: str) -> None:
    assert catalog.check(kind, toy_job(), {"preset": preset}).errors == [message]

"""A scenario file is read whole or refused with every error named."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomlkit

from inkloop.commands.options import overrides_of
from inkloop.contract import PassOrder
from inkloop.errors import ScenarioError
from inkloop.fmu_writer.export import find_fmu
from inkloop.master.orientation import Orientation
from inkloop.scenario.file import Scenario
from inkloop.scenario.overrides import apply_overrides
from inkloop.scenario.validation import _is_beyond
from inkloop.tables.job import component_seed
from inkloop.tables.shapes import Bounds, Grid
from support.parts import TWO_INKS, with_part
from support.places import SCENARIOS

GOOD = """
title = "small"
[grid]
nx = 9
ny = 8
[part]
shape = "cuboid"
size_x_um = 1316.28
size_y_um = 1053.024
height_um = 22.8
[components.controller]
kind = "OpenLoop"
[components.printer]
kind = "LayerDeposition"
[components.profiler]
kind = "ProfileSensor"
scan_duration_s = 0.0
"""


def errors_of(tmp_path: Path, text: str, overrides: Mapping[str, Any] | None = None) -> tuple[str, ...]:
    path = tmp_path / "case.toml"
    path.write_text(text)
    with pytest.raises(ScenarioError) as caught:
        Scenario.load(path, overrides)
    assert str(path) in str(caught.value)
    return caught.value.errors


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("nx = 9", "nx = 0", "grid.nx is 0"),
        ("nx = 9", 'nx = "9"', "grid.nx is '9'; expected a whole number, without quotes and without a unit"),
        ('title = "small"', 'title = "small"\nevents = [1]', "events.[0] is 1; expected a table, [[events]]"),
        ("nx = 9", "nz = 9", "grid.nz is not a key of this table; did you mean nx or ny?"),
        ("height_um", "hight_um", "did you mean height_um?"),
        ('"cuboid"', '"cone"', "part.shape is 'cone'; expected one of cylinder, cuboid, staircase, pipe-junction"),
        ('shape = "cuboid"', "", "part.shape is missing"),
        ("scan_duration_s", "scan_duration", "scan_duration is a time; write scan_duration_s"),
        ("scan_duration_s = 0.0", 'scan_duration_s = "fast"', "components.profiler.scan_duration_s"),
        ("[components.profiler]", "[components.profiler]\nnoise = 1", "components.profiler.noise is no option"),
        ("[components.printer]", '[components."a.b"]', 'components."a.b" has a dot, which separates it'),
        ("[components.printer]", '[components.""]', 'components."" has no name; rename it'),
        ("[grid]", '[compare.x.components.controler]\nkind = "OpenLoop"\n[grid]', "did you mean controller?"),
    ],
)
def test_each_error_is_named_with_its_place(tmp_path: Path, old: str, new: str, error: str) -> None:
    assert old in GOOD
    found = errors_of(tmp_path, GOOD.replace(old, new))
    assert any(error in sentence for sentence in found)
    assert len(found) == 1 or "compare" not in new


@pytest.mark.parametrize(("axis", "pitches"), [("x", 1.0), ("x", 7.0), ("y", 0.5), ("y", 6.5)])
def test_part_may_reach_beyond_no_side_of_the_grid(axis: str, pitches: float, tmp_path: Path) -> None:
    """The part is 5 x 4 cells, the grid 9 x 8: on that side a row of cells lies outside."""
    text = GOOD.replace("height_um = 22.8", f"height_um = 22.8\ncenter_{axis}_um = {pitches * 263.256}")
    (error,) = errors_of(tmp_path, text)
    assert error.startswith("part reaches beyond the grid of 9 x 8 cells")


@pytest.mark.parametrize("margin", [0, 2])
@pytest.mark.parametrize("side", Bounds._fields)
def test_part_that_ends_on_the_centre_of_a_cell_outside_reaches_beyond(margin: int, side: str) -> None:
    grid = Grid(nx=9, ny=8, pitch_um=100.0)
    first, count = margin - 1, {"x": grid.nx, "y": grid.ny}[side[0]] - margin
    inside = Bounds(3 * grid.pitch, 4 * grid.pitch, 3 * grid.pitch, 4 * grid.pitch)
    edge = (first if side.endswith("min") else count) * grid.pitch
    assert not _is_beyond(grid, margin, inside)
    assert _is_beyond(grid, margin, inside._replace(**{side: edge}))
    nearer = np.nextafter(edge, inside.x_min)
    assert not _is_beyond(grid, margin, inside._replace(**{side: nearer}))


@pytest.mark.parametrize(("axis", "pitches"), [("x", 2.0), ("x", 6.0), ("y", 1.5), ("y", 5.5)])
def test_part_may_end_on_the_outer_cells_of_the_grid(axis: str, pitches: float, tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(GOOD.replace("height_um = 22.8", f"height_um = 22.8\ncenter_{axis}_um = {pitches * 263.256}"))
    assert Scenario.load(path).job().mask.sum() == 5 * 4


EVENT = '\n[[events]]\nat_layer = 1\naction = "bias"\nport = "profilr.measured_height"\nvalue_um = 1.0\n'


@pytest.mark.parametrize(
    ("old", "new", "error"),
    [
        ("nx = 9", "nx = 0", "grid.nx is 0"),
        ("scan_duration_s = 0.0", "noise_std_um = -1.0", "components.profiler.noise_std_um"),
        ("size_x_um = 1316.28", "size_x_um = 13162.8", "part reaches beyond the grid"),
    ],
)
def test_wrong_port_of_an_event_is_named_with_other_errors(tmp_path: Path, old: str, new: str, error: str) -> None:
    events = EVENT + EVENT.replace("profilr.measured_height", "printer.hieght")
    found = "\n".join(errors_of(tmp_path, GOOD.replace(old, new) + events))
    for expected in (error, "events.[0].port is 'profilr.measured_height'", "events.[1].port is 'printer.hieght'"):
        assert found.count(expected) == 1


def test_event_on_an_invalid_component_is_not_blamed(tmp_path: Path) -> None:
    text = GOOD.replace("scan_duration_s = 0.0", "noise_std_um = -1.0") + EVENT.replace("profilr", "profiler")
    assert [error.split()[0] for error in errors_of(tmp_path, text)] == ["components.profiler.noise_std_um"]


def test_layers_of_an_event_may_be_those_of_an_invalid_controller(tmp_path: Path) -> None:
    text = GOOD.replace('"OpenLoop"', '"OpenLoop"\nlayers = -1') + EVENT.replace("profilr", "profiler")
    assert [error.split()[0] for error in errors_of(tmp_path, text)] == ["components.controller.layers"]


def test_file_next_to_the_scenario_is_found_while_other_tables_are_invalid(tmp_path: Path) -> None:
    (tmp_path / "lamp.fmu").write_text("no archive")
    lamp = '[components.lamp]\nkind = "Fmu"\nfile = "lamp.fmu"\n'
    found = "\n".join(errors_of(tmp_path, GOOD.replace("nx = 9", "nx = 0") + lamp))
    assert str(tmp_path / "lamp.fmu") in found


@pytest.mark.parametrize(
    ("options", "errors"),
    [
        ("sweps = 3\nhorizon = 9", ("sweps is not a key of this table; did you mean sweeps?", "horizon is 9")),
        ("horizn = 9", ("horizn is not a key of this table; did you mean horizon?", "horizon is 9")),
        ("alpha = 1.8\nhorizon = 2.5", ("horizon is 2.5; expected", "alpha is 1.8; needs")),
        ('sweps = 3\niteratons = "few"', ("did you mean sweeps?", "did you mean iterations?", "iterations is 'few'")),
        ("certified = true\nhorizn = 1\nalpha = 1.0", ("did you mean horizon?",)),
        ("alpha = 1.8\nsweeps = -1\nuntrusted_layers = -1", ("alpha is 1.8", "sweeps is -1", "untrusted_layers is -1")),
    ],
)
def test_misspelt_key_hides_no_wrong_value_of_its_table(tmp_path: Path, options: str, errors: tuple[str, ...]) -> None:
    found = errors_of(tmp_path, GOOD.replace("nx = 9", "nx = 0").replace('"OpenLoop"', f'"LayerMpc"\n{options}'))
    assert found[0].startswith("grid.nx is 0")
    for error in errors:
        assert "\n".join(found).count(error) == 1


@pytest.mark.parametrize(
    ("kind", "option", "message"),
    [
        ("LayerMpc", "overshoot_limit_um = -2.5", "expected greater than or equal to 0"),
        ("LayerMpc", "sensor_noise_std_um = inf", "expected a finite number"),
        ("CohenLipson", "threshold_um = -2.5", "expected greater than or equal to 0"),
        ("LayerController", "overshoot_limit_um = -2.5", "expected a number in 0 .. 1000000 [um]"),
    ],
)
def test_error_names_key_value_and_limits_as_they_are_written(
    tmp_path: Path, kind: str, option: str, message: str
) -> None:
    (error,) = errors_of(tmp_path, GOOD.replace('"OpenLoop"', f'"{kind}"\n{option}'))
    assert error.startswith(f"components.controller.{option.replace(' =', ' is')}; {message}")


def test_empty_mapping_empties_a_table_in_python_and_on_the_command_line() -> None:
    assert Scenario.load(SCENARIOS / "cuboid.toml").tables.compare
    empty: list[Mapping[str, Any]] = [{"compare": {}}, overrides_of(["compare={}"], "command line")]
    for overrides in empty:
        assert not Scenario.load(SCENARIOS / "cuboid.toml", overrides).tables.compare


def test_mapping_overrides_its_keys_and_an_inline_table_the_whole_part(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(GOOD)
    higher = Scenario.load(tmp_path / "case.toml", {"part": {"height_um": 30.4}})
    assert higher.tables.part.model_dump()["size_x_um"] == 1316.28
    inline = overrides_of(["part={shape='cylinder', radius_um=500.0, height_um=7.6}"], "command line")
    assert Scenario.load(tmp_path / "case.toml", inline).tables.part.shape == "cylinder"
    assert overrides_of(["title=two words"], "command line") == {"title": "two words"}, "what is no TOML is text"


def test_components_draw_from_streams_of_their_own() -> None:
    seeds = {component_seed(seed, name) for seed in range(50) for name in ("printer", "profiler", "controller")}
    assert len(seeds) == 150
    assert component_seed(7, "printer") == component_seed(7, "printer")
    scenario = Scenario.load(SCENARIOS / "cuboid.toml", {"seed": 7})
    assert [scenario.job(name).seed for name in ("printer", "profiler")] == [
        component_seed(7, name) for name in ("printer", "profiler")
    ]


def test_passes_of_the_file_are_those_of_every_job(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(GOOD + '[process]\npasses = 4\npass_order = "diagonal"\npass_rotation = 3\n')
    job = Scenario.load(path).job("controller")
    assert (job.passes, job.pass_order, job.pass_rotation) == (4, PassOrder.DIAGONAL, 3)


def test_value_that_a_controller_refuses_is_an_error_with_its_place_in_every_run(tmp_path: Path) -> None:
    text = GOOD.replace('kind = "OpenLoop"', 'kind = "LayerMpc"\nalpha = 2.0')
    found = errors_of(tmp_path, text + '[compare.x.components.controller]\nkind = "OpenLoop"\nlayers = -1\n')
    assert [error.split(" is ")[0] for error in found] == [
        "components.controller.alpha",
        "compare.x.components.controller.layers",
    ]


def test_loop_of_a_comparison_run_is_checked_with_the_file(tmp_path: Path) -> None:
    errors = errors_of(tmp_path, GOOD + '[compare."no sensor".components.profiler]\nkind = "LayerDeposition"\n')
    assert all(error.startswith("compare.no sensor: controller.") for error in errors)
    assert errors[0].startswith("compare.no sensor: controller.measured_height is not connected")
    blind = GOOD.replace('"ProfileSensor"\nscan_duration_s = 0.0', '"LayerDeposition"')
    errors = errors_of(tmp_path, blind + '[compare.x.components.controller]\nkind = "OpenLoop"\n')
    assert errors[0].startswith("controller.measured_height is not connected")
    assert not [error for error in errors if error.startswith("compare")], "an error of both is told once"


def test_fmu_of_a_comparison_run_is_foreign_and_found_from_here(tmp_path: Path) -> None:
    (tmp_path / "fmus").mkdir()
    shutil.copyfile(find_fmu("ProfileSensor", "fmi3"), tmp_path / "fmus" / "sensor.fmu")
    text = GOOD + '[compare.x.components.profiler]\nkind = "Fmu"\nfile = "fmus/sensor.fmu"\n'
    scenario = Scenario.of_text(text, str(tmp_path / "case.toml"))
    assert scenario.foreign_fmus == ["compare.x.components.profiler"]
    assert scenario.variant("x").options("profiler") == {"file": str(tmp_path / "fmus" / "sensor.fmu")}
    assert scenario.options("profiler") == {"scan_duration_s": 0.0}


WIRE = '\n[[connections]]\nsource = "printer.height"\ntarget = "profiler.height"\n'


@pytest.mark.parametrize("kind", ["none", None])
def test_margin_is_kept_empty_for_a_support_only(tmp_path: Path, kind: str | None) -> None:
    """The part ends on the outer cells."""
    text = GOOD.replace("height_um = 22.8", "height_um = 22.8\ncenter_x_um = 526.512")
    support = "[support]\n" + ('kind = "none"\n' if kind else "")
    if kind is None:
        assert "less its margin of 2" in errors_of(tmp_path, text + support)[0]
        return
    assert Scenario.of_text(text + support, str(tmp_path / "case.toml")).job().mask.sum() == 5 * 4


def test_options_of_a_file_with_other_errors_are_checked_on_its_own_grid(tmp_path: Path) -> None:
    """Of 120 x 2 cells."""
    rows = f"height_start_um = {[[0.5, 0.5]] * 120}"
    text = GOOD.replace("nx = 9\nny = 8", "nx = 120\nny = 2").replace('"LayerDeposition"', f'"LayerDeposition"\n{rows}')
    (error,) = errors_of(tmp_path, text.replace("height_um = 22.8", "height_um = -1.0"))
    assert error.startswith("part.height_um is -1.0")


def test_offset_of_a_connection_comes_in_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(GOOD + WIRE + "gain = 1.5\noffset_um = 20\n")
    wire, *_ = Scenario.load(path).connections
    assert (wire.target, wire.gain) == ("profiler.height", 1.5)
    assert wire.offset == pytest.approx(20e-6, rel=1e-9, abs=0.0)


def test_orientation_of_a_connection_is_that_of_the_file() -> None:
    text = GOOD.replace("ny = 8", "ny = 9") + WIRE + 'mirror = "y"\ntranspose = true\n'
    wire, *others = Scenario.of_text(text, "case.toml").connections
    assert wire.orientation == Orientation("y", True)
    assert all(other.orientation.is_own for other in others)


@pytest.mark.parametrize(
    ("key", "message"),
    [
        ("offset = 1.0", "connections.[0].offset is a length; write offset_um"),
        ("offset_um = true", "connections.[0].offset_um is True; expected a finite number"),
        ("gian = 2.0", "connections.[0].gian is not a key of this table; did you mean gain?"),
        ("gain = nan", "connections.[0].gain is nan; expected a finite number"),
    ],
)
def test_error_of_a_gain_or_an_offset_is_named(tmp_path: Path, key: str, message: str) -> None:
    (error,) = errors_of(tmp_path, f"{GOOD}{WIRE}{key}\n")
    assert error.startswith(message)


def test_text_of_a_variant_states_what_it_prints(tmp_path: Path) -> None:
    path = tmp_path / "variant.toml"
    path.write_text(Scenario.load(SCENARIOS / "cylinder.toml").variant("open loop").text, encoding="utf-8")
    again = Scenario.load(path).tables
    assert (again.label, again.components["controller"].kind, again.compare) == ("open loop", "OpenLoop", {})
    assert again.literature == {}, "the published figures are those of the other run"


def test_part_of_files_is_another_one_when_any_of_its_ends_is_another(tmp_path: Path) -> None:
    """A run is resumed with the same part only."""
    parts = [TWO_INKS, *(TWO_INKS.replace(*change) for change in (
        ("height_um = 30.0", "height_um = 31.0"), ("height_um = 20.0", "height_um = 21.0"),
        ("size_x_um = 400.0", "size_x_um = 200.0"), ('["A", "B"]', '["B", "A"]'),
        ("center_x_um = 450.0", "center_x_um = 350.0"),
    ))]  # fmt: skip
    hashes = [with_part(text, tmp_path).part_sha256 for text in (*parts, TWO_INKS)]
    assert None not in hashes
    assert len(set(hashes)) == len(parts)
    assert hashes[0] == hashes[-1]


def test_classes_are_checked_on_a_whole_grid_where_the_part_covers_no_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The errors of the part come alone, without one more from a component that reads its first cell."""
    (tmp_path / "first_of_the_part.py").write_text("""class First:
    def __init__(self, job):
        self.first = [index[0] for index in job.mask.nonzero()]

    def pattern(self, height, layer):
        return (0 * height).astype(int)
""")
    monkeypatch.syspath_prepend(tmp_path)
    text = GOOD.replace("height_um = 22.8", "height_um = 22.8\ncenter_x_um = -9e6")
    found = errors_of(tmp_path, text.replace('"OpenLoop"', '"first_of_the_part:First"'))
    assert [error.partition(" of the grid")[0] for error in found[:1]] == ["part covers no cell"]
    assert all(error.startswith("part ") for error in found)


def test_overrides_change_the_run_and_its_record(tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(GOOD)
    job = Scenario.load(path).job("printer")
    assert (job.nx, job.ny, int(job.mask.sum()), job.pitch) == (9, 8, 20, pytest.approx(263.256e-6, rel=1e-9, abs=0.0))
    variation = {"variation": np.float64(0.3)}
    scenario = Scenario.load(path, {"grid.nx": np.int64(11), "components.printer": variation, "title": Path("wide")})
    assert (scenario.job().nx, scenario.tables.title) == (11, "wide")
    assert scenario.tables.components["printer"].options == {"variation": 0.3}
    path.write_text(scenario.text)
    assert Scenario.load(path).tables == scenario.tables


@pytest.mark.parametrize(
    ("overrides", "title", "is_published"),
    [
        ({}, "C", True),
        ({"seed": 7}, "C (seed = 7)", True),
        ({"components.printer.variation": 0.4}, "C (printer.variation = 0.4)", False),
        ({"grid": {"nx": 40, "ny": 41}, "seed": 2, "run.layers_max": 9}, "C (grid.nx = 40, grid.ny = 41, seed = 2, "
         "1 more)", False),
        ({"components.printer": {"kind": "LayerDeposition"}}, "C (printer.kind = LayerDeposition)", False),
        ({"label": "mine"}, "C", True),
        ({"bench.cure_ms": 70}, "C", True),
        ({"label": "mine", "title": "Own", "literature.Lu.std_um": 3.0}, "Own", True),
    ],
)  # fmt: skip
def test_title_says_what_was_overridden_and_published_figures_are_those_of_the_file(
    overrides: dict[str, Any], title: str, is_published: bool
) -> None:
    text = (SCENARIOS / "cylinder.toml").read_text(encoding="utf-8").replace("Cylinder, 20 % droplet variation", "C")
    found = Scenario.of_text(text, "cylinder.toml", overrides).tables
    assert found.title == title
    assert bool(found.literature) == is_published


def test_title_shows_thirty_characters_of_a_value() -> None:
    for text, shown in (("x" * 30, "x" * 30), ("x" * 31, "x" * 30 + "...")):
        document = tomlkit.parse('title = "C"\n')
        assert apply_overrides(document, {"components.controller.kind": text}) == []
        assert document["title"] == f"C (controller.kind = {shown})"


def test_override_may_add_a_component_by_its_kind(tmp_path: Path) -> None:
    (tmp_path / "case.toml").write_text(GOOD)
    kind = {"components.shadow.kind": "Shadow", "components.shadow.start": "job"}
    assert Scenario.load(tmp_path / "case.toml", kind).tables.components["shadow"].options == {"start": "job"}


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"grid": {"nx": {"far": 3}}}, "grid.nx.far: nx is not a table"),
        ({"grid.nx": None}, "grid.nx is None; expected a number, a string, true or false, a list or a table"),
        ({"grid.nx": 1j}, "grid.nx is 1j; expected a number, a string, true or false, a list or a table"),
        (
            {"components.controler.alpha": 1},
            "components.controler.alpha: there is no components.controler; did you mean",
        ),
        (
            {"printer.variation": 0.4},
            "printer.variation: there is no table printer; did you mean components.printer.variation?",
        ),
    ],
)
def test_override_that_cannot_be_set_is_named(tmp_path: Path, overrides: dict[str, Any], message: str) -> None:
    (found,) = errors_of(tmp_path, GOOD, overrides)
    assert found.startswith(message)
    with pytest.raises(TypeError, match="expected a mapping"):
        Scenario.load(tmp_path / "case.toml", ["grid.nx=11"])  # type: ignore[arg-type]

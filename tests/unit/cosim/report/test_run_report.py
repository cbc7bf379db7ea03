"""Tables, sentences and plain values of runs against the figures of their surfaces."""

from __future__ import annotations

import json
import platform
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.printing import run as printing_run
from inkloop.printing.run import new_run_folder, print_part
from inkloop.report import run_report
from inkloop.report.remarks import remarks, stop_remarks, untrusted_remarks
from inkloop.report.run_report import Summary
from inkloop.results.lock import LOCK_FILE
from inkloop.results.recorder import LayerRow
from inkloop.results.result import Result
from inkloop.results.surface import subject_of, surface
from inkloop.scenario.file import Scenario
from inkloop_controller.estimation.estimate_figures import TRANSFORMS
from support.prints import quick_cuboid

CUBOID = quick_cuboid()

UNSEEN = pytest.mark.xfail(
    strict=True, reason="a cell that was not seen counts once it is unsure by 0.3 layers, not after untrusted_layers"
)


@pytest.mark.system
def test_compare_shows_each_run_and_writes_the_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [str(tmp_path / str(seed)) for seed in (1, 2)]
    for seed, folder in enumerate(runs, 1):
        print_part(Scenario.load(CUBOID, {"run.layers_max": 2, "seed": seed})).save(Path(folder))
    picture = tmp_path / "both.png"
    assert main(["compare", *runs, "--out", str(picture)]) == 0
    assert capsys.readouterr().out.count(runs[0][:20]) == 3  # the labels are the same; of the picture too
    assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("inkloop.report.pictures.draw_comparison", lambda *_: [Path("both.png")])
        assert main(["compare", *runs, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (sorted(found["runs"]), found["pictures"]) == (runs, ["both.png"])


@pytest.mark.system
@pytest.mark.usefixtures("without_pictures")
@pytest.mark.parametrize(
    ("port", "value", "message"),
    [
        pytest.param("profiler.valid", "false", "untrusted cells: 2, ", marks=UNSEEN),
        pytest.param("printer.pattern", "0", "dead cells: 2, ", marks=pytest.mark.long),
    ],
)
def test_cells_that_cannot_be_printed_or_seen_are_reported_when_the_run_ends_and_by_info(
    port: str, value: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    event = f'at_layer = 1\naction = "override"\nport = "{port}"\nvalue = {value}\ncells = [[6, 6], [7, 6]]\n'
    broken = tmp_path / "broken.toml"
    broken.write_text(f"{CUBOID.read_text(encoding='utf-8')}\n[[events]]\n{event}", encoding="utf-8")
    for scenario, expected in ((CUBOID, False), (broken, True)):
        folder = str(tmp_path / scenario.stem)
        assert main(["run", str(scenario), "--out", folder, "--no-compare"]) == 0
        assert (message in capsys.readouterr().out) is expected
        assert main(["info", folder]) == 0
        assert (message in capsys.readouterr().out) is expected


@pytest.mark.system
@pytest.mark.usefixtures("without_pictures")
def test_reasons_for_no_trust_are_reported_with_figure_place_and_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, wrong = str(tmp_path / "wrong"), ["--set", "components.profiler.bias_um=30"]
    wrong += ["--set", "components.controller.on_doubt=continue"]
    assert main(["run", str(CUBOID), "--out", folder, "--no-compare", *wrong]) == 0
    message = "ground that the scenario calls flat at 30.0 µm in the middle"
    assert message in " ".join(capsys.readouterr().out.split())
    assert main(["info", folder]) == 0
    assert message in " ".join(capsys.readouterr().out.split())


def test_every_reason_has_a_sentence_of_its_own() -> None:
    layers = 4
    values = {
        "untrusted_reasons": [0, 30, 48, 0],
        "blind_share": [0.0, 0.75, 0.1, 0.0],
        "ground_offset": [5e-6] * layers,
        "ground_rise_x": [1e-6] * layers,
        "ground_rise_y": [-2e-6] * layers,
        "scan_surprise": [1.0, 4.2, 2.0, 1.0],
        "capped_cells": [0, 2, 7, 0],
        "ink_excess": [0.0, 3e-6, 41e-6, 50e-6],
        "ink_excess_i": [0, 5, 6, 7],
        "ink_excess_j": [0, 1, 2, 3],
        "height_excess": [0.0, 12e-6, 9e-6, 0.0],
        "height_excess_i": [0, 0, 1, 0],
        "height_excess_j": [0, 0, 2, 0],
    }
    run = xr.Dataset({name: ("layer", value) for name, value in values.items()})
    blind, ground, residuals, ink, high = untrusted_remarks(run)
    assert blind.startswith("75% of the part's cells were not measured in the scan of layer 0, after more than")
    assert "at 5.0 µm in the middle, rising by 1.0 µm along x and -2.0 µm along y" in ground
    assert "by 4.2 times what droplets and sensor explain, most in the scan of layer 0;" in residuals
    assert ink.startswith("capped cells: 7, ")
    assert "cell (6, 2) is 41.0 µm higher than by the scan of layer 1" in ink
    expected = "cell (1, 2) stood 9.0 µm above its target and what its droplets explain in the scan of layer 1;"
    assert high.startswith(expected)
    assert untrusted_remarks(run.assign(untrusted_reasons=("layer", [0, 1, 1, 0]))) == []
    (blind,) = untrusted_remarks(run.assign(untrusted_reasons=("layer", [0, 2, 2, 2])))
    assert blind.startswith("75% of the part's cells were not measured in the scan of layer 0 (3 layers in all, from ")
    (residuals,) = untrusted_remarks(run.assign(untrusted_reasons=("layer", [0, 0, 8, 8])))
    assert "by 2.0 times" in residuals
    assert "most in the scan of layer 1 (2 layers in all, from layer 1 on);" in residuals


def stopped_run(reason: int, figure: float = 2.5, transform: int = 0, **more: Any) -> xr.Dataset:
    """A print of four layers that the scan of the last one stopped."""
    values = {"stop_reason": reason, "stop_layer": 4, "stop_figure": figure, "stop_transform": transform}
    return xr.Dataset({name: ("layer", [0, 0, 0, 0, value]) for name, value in values.items()}, attrs=more)


@pytest.mark.parametrize(
    ("reason", "transform", "messages"),
    [
        (
            64,
            0,
            ("nothing grew", "scan of layer 4", "2.5 times better", "the head jets nothing", "the profiler does not"),
        ),
        (128, 0, ("the scan of an earlier layer again, the same to the last bit", "layer 4", "restart the profiler")),
        (256, 0, ("scans lag by a layer", "layer 4", "2.5 times better", "when the layer is complete")),
        (512, 2, ("mirrored in x", "layer 4", "2.5 times better", 'mirror = "x"', "offset_x_um")),
        (512, 3, ("mirrored in y", 'mirror = "y"', "offset_y_um")),
        (512, 4, ("turned by 180 degrees", "Add 180 to rotation_deg")),
        (512, 5, ("transposed against", "rows_along", "set transpose in `ports`", "fastest")),
        (512, 6, ("turned by 90 degrees", "Add 90 to rotation_deg")),
        (512, 7, ("turned by 270 degrees", "Add 270 to rotation_deg")),
        (512, 8, ("transposed and turned by 180 degrees", "rows_along", "add 180 to rotation_deg")),
        (1024, 0, ("2.50 of the nominal volume", "layer 4", "0.5 to 1.25 (volume_least", "`inkloop identify`", "gain")),
    ],
)
def test_every_reason_for_a_stop_says_what_was_seen_where_and_what_to_do(
    reason: int, transform: int, messages: tuple[str, ...]
) -> None:
    (found,) = stop_remarks(stopped_run(reason, transform=transform))
    for message in messages:
        assert message in found
    continued = stopped_run(reason, transform=transform).rename(stop_reason="untrusted_reasons")
    (remark,) = untrusted_remarks(continued)
    assert remark == f"continued all the same: {found}"


def test_transforms_are_those_of_the_controller_and_volumes_those_of_the_scenario() -> None:
    for number, name in enumerate(TRANSFORMS):
        if name:
            assert f"scans are {name} against" in stop_remarks(stopped_run(512, transform=number))[0]
    scenario = "[components.controller]\nkind = 'LayerMpc'\nvolume_most = 2.0\n"
    assert "0.5 to 2 (volume_least, volume_most)" in stop_remarks(stopped_run(1024, scenario=scenario))[0]


def test_stop_of_a_print_that_went_on_is_reported_as_history() -> None:
    stopped = stopped_run(64).assign_attrs(stop_reason="stopped")
    (found,) = remarks(Result(stopped, {}))
    assert found.startswith("stopped: the scans do not show what was printed: nothing grew")
    (found,) = remarks(Result(stopped.assign_attrs(stop_reason="done"), {}))
    assert found.startswith("was stopped and resumed: nothing grew")
    twice = stopped.assign(stop_reason=("layer", [0, 0, 128, 0, 64]), stop_layer=("layer", [0, 0, 2, 0, 4]))
    end, earlier = remarks(Result(twice, {}))
    assert end.startswith("stopped: the scans do not show what was printed: nothing grew")
    assert earlier.startswith("was stopped and resumed: the profiler shows the scan of an earlier layer again")
    assert "as that of layer 2;" in earlier
    continued = twice.assign(untrusted_reasons=("layer", [0, 0, 64, 0, 64])).drop_vars("stop_reason")
    (found,) = untrusted_remarks(continued)
    assert "up to the scan of layer 4:" in found


def test_what_a_time_limit_left_out_is_counted_by_stage() -> None:
    dataset = xr.Dataset({"left_out": ("layer", [0, 4, 13, 4])}, attrs={"stop_reason": "done"})
    (found,) = remarks(Result(dataset, {}))
    expected = "the time limit left out or cut short, in how many of 3 layers: relaxation 1, repair 3, fewer layers 1;"
    assert found.startswith(expected)
    assert remarks(Result(dataset.assign(left_out=("layer", [0, 0, 0, 0])), {})) == []


@pytest.mark.parametrize(
    ("layers", "start"),
    [([0, 0, 0, 0], ""), ([0, 0, 1, 0], "layer 2 was aborted"), ([0, 1, 0, 1], "layers 1, 3 were aborted")],
)
def test_every_aborted_layer_is_named(layers: list[int], start: str) -> None:
    dataset = xr.Dataset({"layer_unknown": ("layer", np.array(layers, bool))}, attrs={"stop_reason": "done"})
    found = remarks(Result(dataset, {}))
    assert len(found) == bool(start)
    assert all(remark.startswith(start) for remark in found)


MASK = np.zeros((4, 3), np.bool_)
MASK[1:3, :2] = True
ERRORS_UM = np.array([1.0, 2.0, 3.0, -4.0])
"""Of the four cells of the part: mean 0.5, mean absolute 2.5, mean square 7.5."""
STD_UM = float(np.sqrt(7.5 - 0.25))
PITCH_UM = 250.0
TEXT = """title = "Plate"
[literature.Lu]
mean_error_um = 1.5
std_um = 0.25
note = "their rig"
[literature.Wu]
std_um = 3.0
"""


def run(label: str = "closed loop", scale: float = 1.0, stop_reason: str = "done", **more: Any) -> Result:
    """Two layers of a plate 30 um high; its errors are `scale` times those above."""
    target = np.where(MASK, 30e-6, 0.0)
    height = np.zeros((3, 4, 3))
    height[1][MASK], height[2][MASK] = 10e-6, 30e-6 - scale * 1e-6 * ERRORS_UM
    height[:, 0, 2], height[1:, 3, 2] = 5e-6, [2e-6, 7e-6]  # ground, and ink beside the part
    pattern = np.zeros((3, 4, 3), np.int32)
    pattern[1, 1:3, :2], pattern[2, 1, 0] = 1, 2
    maps = {name: (("layer", "x", "y"), values) for name, values in {"height": height, "pattern": pattern}.items()}
    dataset = xr.Dataset(
        {**maps, "target_height": (("x", "y"), target), "mask": (("x", "y"), MASK), **more},
        {"layer": np.arange(3), "x": np.arange(4) * PITCH_UM * 1e-6, "y": np.arange(3) * PITCH_UM * 1e-6},
        {"pitch": PITCH_UM * 1e-6},
    )
    found = Result.of(
        dataset, title="Plate", label=label, scenario_text=TEXT, seed=11, stop_reason=stop_reason,
        wall_s={"total": 2.345, "controller": 1.5}, components={}, notes={"events": ["layer 1: nozzle 5 is dead"]},
    )  # fmt: skip
    return found


def test_table_has_a_row_for_each_run_and_for_what_was_published() -> None:
    summary = Summary.of({"closed loop": run(), "open loop": run("open loop", -2.0)})
    assert [heading.replace("\n", " ") for heading in summary.headings] == [
        "run", "mean error", "mae", "std", "layers", "droplets", "spill [nl]", "wall [s]",
    ]  # fmt: skip
    assert summary.rows == [
        ["closed loop", "0.50", "2.50", f"{STD_UM:.2f}", "2", "5", "0.4375", "2.35"],
        ["open loop", "-1.00", "5.00", f"{2 * STD_UM:.2f}", "2", "5", "0.4375", "2.35"],
        ["Lu (their rig)", "1.5", "-", "0.25", "-", "-", "-", "-"],
        ["Wu (another plant)", "-", "-", "3", "-", "-", "-", "-"],
    ]
    assert (summary.title, summary.difference, summary.surface) == ("Plate", None, None)
    text = str(summary)
    assert "errors over the part in µm: target minus height (too low +, too high -)" in text
    assert text.startswith("Plate\n")


def test_mismatch_and_wall_time_are_shown_where_a_run_has_them() -> None:
    unended = run()
    unended.run["wall_s"]["total"] = float("nan")
    summary = Summary.of({"two": run(mismatch=0.125), "one": unended})
    assert summary.headings[4].replace("-\n", "") == "mismatch"
    assert [row[4] for row in summary.rows] == ["12.5%", "-", "-", "-"]
    assert [row[-1] for row in summary.rows[:2]] == ["2.35", "-"]
    assert {len(row) for row in summary.rows} == {len(summary.headings)}


def test_plain_values_are_those_of_the_run_in_units_of_people() -> None:
    found = run_report.figures({"a": run(mismatch=0.125)})["a"]
    expected = {
        "mean_error_um": 0.5, "mae_um": 2.5, "rms_um": 7.5**0.5, "std_um": STD_UM, "min_um": -4.0, "max_um": 3.0,
        "mismatch": 0.125, "layers": 2, "droplets": 5, "spill_nl": 0.4375, "wall_s": 2.345,
    }  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert (found["stop_reason"], found["remarks"]) == ("done", [])
    assert set(found) == {*expected, "stop_reason", "remarks"}


def test_info_says_where_a_run_came_from_and_how_it_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run(stop_reason="layers_max").save(tmp_path / "plate")
    assert main(["info", str(tmp_path / "plate")]) == 0
    lines = " ".join(capsys.readouterr().out.split())
    for words in (
        "Plate (closed loop)",
        "grid: 4 x 3 cells of 250 µm",
        "seed: 11",
        "ended: layers_max, after 2 layers and 5 droplets",
        "errors over the part (too low +, too high -): mean error 0.50 µm, mean absolute error 2.50 µm, "
        f"standard deviation {STD_UM:.2f} µm",
        "event: layer 1: nozzle 5 is dead",
        "wall time: total 2.35 s, controller 1.50 s",
        f"versions: python {platform.python_version()}, inkloop ",
        f"numpy {np.__version__}",
        f"platform: {platform.platform()}",
    ):
        assert words in lines


def test_runs_of_a_folder_are_the_run_itself_and_its_comparison_runs_that_have_ended(tmp_path: Path) -> None:
    run().save(tmp_path)
    for name in ("b", "a", "c"):
        run(f"run {name}", stop_reason="layers_max").save(tmp_path / "compare" / name)
    record = tmp_path / "compare" / "a" / "run.json"
    record.write_text(json.dumps({**json.loads(record.read_text()), "stop_reason": "running"}))
    assert list(run_report.load_runs(tmp_path)) == ["closed loop", "run b", "run c"]
    in_memory = {tmp_path / "compare" / "a": run("of a"), tmp_path: run("main")}
    found = run_report.load_runs(tmp_path, in_memory)
    assert list(found) == ["main", "of a", "run b", "run c"]
    assert found["main"] is in_memory[tmp_path]


@pytest.mark.parametrize("reason", ["interrupted", "failed", "stopped", "done", "layers_max"])
def test_row_of_a_run_whose_part_is_not_complete_says_so(tmp_path: Path, reason: str) -> None:
    run().save(tmp_path / "whole")
    run("open loop", stop_reason=reason).save(tmp_path / "cut")
    table, found, _ = run_report.compare([tmp_path / "whole", tmp_path / "cut"], tmp_path / "both", ())
    name = "open loop" if reason in ("done", "layers_max") else f"open loop, {reason}"
    assert [str(cell) for cell in table.columns[0].cells] == ["closed loop", name]
    assert list(found) == ["closed loop", "open loop"]


def test_compared_runs_are_named_by_label_or_by_folder(tmp_path: Path) -> None:
    folders = [tmp_path / name for name in ("first", "second", "third")]
    for folder, result in zip(folders, (run(), run("open", 2.0), run("open", 3.0)), strict=True):
        result.save(folder)
    table, found, written = run_report.compare(folders[:2], tmp_path / "both", ())
    assert (list(found), written) == (["closed loop", "open"], [])
    assert [found[name]["mae_um"] for name in found] == pytest.approx([2.5, 5.0], rel=1e-9, abs=0.0)
    assert [str(cell) for cell in table.columns[0].cells] == ["closed loop", "open"]  # nothing published
    found = run_report.compare(folders, tmp_path / "all", ())[1]
    assert [found[str(folder)]["mae_um"] for folder in folders] == pytest.approx([2.5, 5.0, 7.5], rel=1e-9, abs=0.0)
    for change, message in (({"x": slice(3)}, "3 x 3 cells of 250 µm"), ({}, "4 x 3 cells of 300 µm")):
        other = run().dataset.isel(change).assign_attrs(pitch=250e-6 if change else 300e-6)
        Result(other, run().run).save(folders[2])
        with pytest.raises(ResultError, match=f"third: printed on {message}, but .*first on 4 x 3 cells of 250 µm"):
            run_report.compare(folders, tmp_path / "all", ("png",))


def shadowed(status: list[int], growth_um: list[float]) -> list[str]:
    rows = {"shadow_status": status, "growth_divergence": np.array(growth_um) * 1e-6}
    return remarks(Result(xr.Dataset({name: ("layer", each) for name, each in rows.items()}, attrs=ENDED), {}))


ENDED = {"stop_reason": "layers_max"}


def test_alarms_of_a_shadow_name_the_worst_layer() -> None:
    assert shadowed([0, 0, 0], [np.nan, 3.0, 4.0]) == []
    assert shadowed([0, 4, 0], [np.nan, 3.0, 4.0]) == [
        "layer 1 grew differently from the shadow's model, by 3.00 µm rms"
    ]
    assert shadowed([0, 4, 3, 4], [np.nan, 3.0, 5.5, 4.0]) == [
        "layer 2 grew differently from the shadow's model, by 5.50 µm rms; 3 layers in all, the first is layer 1"
    ]
    unseen = "layer 1 could not be compared with the model"
    assert shadowed([0, 4, 4], [np.nan, np.nan, np.nan]) == [unseen]
    assert shadowed([0, 4, 4], [np.nan, np.nan, 2.0])[1:] == [unseen]


def test_corrected_scans_and_lost_cells_are_those_of_the_last_layer() -> None:
    rows = {
        "scan_corrected": [0, 1, 1], "scan_shift_x": [0.0, 1e-6, 12e-6], "scan_shift_y": [0.0, 1e-6, -3.4e-6],
        "scan_shift_std": [0.0, 1e-6, 0.5e-6], "scan_spot_radius": [0.0, 0.0, 40e-6],
        "untrusted_cells": [0, 9, 2], "dead_cells": [0, 3, 0],
    }  # fmt: skip

    def said(**changed: list[float]) -> list[str]:
        values = {name: ("layer", each) for name, each in {**rows, **changed}.items()}
        return remarks(Result(xr.Dataset(values, attrs=ENDED), {}))

    untrusted, scans = said()
    assert untrusted == "untrusted cells: 2, unseen for too long, their heights are predictions"
    assert scans == (
        "scans were corrected: the last one was shifted by 12.0 µm along x and -3.4 µm along y (+- 0.5 µm), and the "
        "spot is 40 µm wide (standard deviation); register the profiler with the printer"
    )
    assert "spot" not in said(scan_spot_radius=[1e-6, 1e-6, 0.0])[1]
    (dead,) = said(untrusted_cells=[1, 1, 0], dead_cells=[0, 0, 4], scan_corrected=[1, 1, 0])
    assert dead == "dead cells: 4, droplets commanded there bring nothing"


@pytest.mark.parametrize(("layers", "reason", "is_said"), [(1, "done", True), (2, "done", False), (1, "fault", False)])
def test_print_that_printed_nothing_is_explained(layers: int, reason: str, is_said: bool) -> None:
    dataset = xr.Dataset(coords={"layer": np.arange(layers)}, attrs={"stop_reason": reason})
    assert any(each.startswith("nothing was printed") for each in remarks(Result(dataset, {}))) is is_said


def test_bar_follows_the_height_that_is_built(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        LayerRow(layer, 0.0, mean, 0.0, 1.5e-6, {"solve_time": 0.0123} if layer else {})
        for layer, mean in enumerate((40e-6, 30e-6, 10e-6, -2e-6))
    ]

    def print_(*_: Any, on_layer: Any, **__: Any) -> Any:
        """Stands for a print; tells its rows."""
        return SimpleNamespace(run=lambda: [on_layer(row) for row in rows] and run())

    monkeypatch.setattr("inkloop.printing.run.Print", print_)
    scenario: Any = SimpleNamespace(tables=SimpleNamespace(label="closed loop"))
    shown: list[dict[str, Any]] = []
    told: Any = SimpleNamespace(add_task=lambda *_, **__: 0, update=lambda task, **fields: shown.append(fields))
    print_part(scenario, told)
    assert [each["completed"] for each in shown] == pytest.approx([0.0, 0.25, 0.75, 1.0, 1.0], rel=1e-9, abs=0.0)
    assert shown[1]["figures"] == "layer 1: mean error 30.00, std 1.50 µm"
    assert [each["solve"] for each in shown[:2]] == ["", "plan 12.3 ms"]


def test_new_folder_is_the_first_that_is_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    found = [new_run_folder(None, "plate").as_posix() for _ in range(3)]
    assert found == ["runs/plate", "runs/plate-2", "runs/plate-3"]
    assert new_run_folder(tmp_path / "own", "plate") == tmp_path / "own"
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / LOCK_FILE).touch()
    assert new_run_folder(tmp_path / "own", "plate") == tmp_path / "own"
    (tmp_path / "file").touch()
    for place in (tmp_path / "file", tmp_path / "runs"):
        with pytest.raises(ResultError, match="is there already and not empty; name another --out"):
            new_run_folder(place, "plate")


def test_comparison_runs_have_folders_of_plain_letters() -> None:
    names: dict[str, Any] = {"open loop": {}, "Half size (50 %)!": {}}
    scenario: Any = SimpleNamespace(tables=SimpleNamespace(compare=names), variant=lambda name: f"variant {name}")
    found = list(printing_run._runs(scenario, Path("out"), True))
    assert [(place.as_posix(), variant) for place, variant in found[1:]] == [
        ("out/compare/open-loop", "variant open loop"),
        ("out/compare/half-size-50", "variant Half size (50 %)!"),
    ]
    assert found[0] == (Path("out"), scenario)
    assert list(printing_run._runs(scenario, Path("out"), False)) == found[:1]


def seen() -> xr.Dataset:
    """A run with scans, in which one cell of layer 1 was not measured."""
    dataset = run().dataset
    measured, valid = dataset.height.values + 1e-6, np.ones((3, 4, 3), np.bool_)
    valid[1, 1, 0] = False
    maps = {"measured_height": measured, "valid": valid}
    return dataset.assign({name: (("layer", "x", "y"), values) for name, values in maps.items()})


def test_surface_of_a_run_is_that_of_its_name_and_layer() -> None:
    dataset = seen()
    last = surface(dataset, "plate")
    np.testing.assert_array_equal(last.z, dataset.height[2])
    assert (last.dx, last.dy) == (250e-6, 250e-6)
    assert last.source == "plate: printed surface after layer 2"
    scan = surface(dataset, "plate", name="measured", layer=1)
    assert np.argwhere(np.isnan(scan.z)).tolist() == [[1, 0]]
    assert scan.z[2, 1] == pytest.approx(11e-6, rel=1e-9, abs=0.0)
    part = surface(dataset, "plate", layer=0, part=True)
    np.testing.assert_array_equal(np.isfinite(part.z), MASK)
    target = surface(dataset, "plate", name="target")
    assert target.source == "plate: target surface"
    assert target.z.max() == 30e-6
    subject = subject_of(dataset, "plate", name="measured", layer=1)
    np.testing.assert_array_equal(subject.start, dataset.height[0])
    np.testing.assert_array_equal(subject.cells, MASK)
    with pytest.raises(ResultError, match=r"holds no layer 3; it has layers 0 \(the start surface\) to 2"):
        surface(dataset, "plate", layer=3)
    with pytest.raises(ResultError, match="holds no layer -1"):
        surface(dataset, "plate", layer=-1)
    with pytest.raises(ResultError, match="holds no estimated surface; it has printed, measured, target"):
        surface(dataset, "plate", name="estimated")
    dataset["height"].attrs["source"] = "measured_height"  # a printer that does not know its surface
    assert np.isnan(surface(dataset, "plate", layer=1).z[1, 0])

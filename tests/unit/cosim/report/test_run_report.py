"""Tables of several runs, and the summary of one run."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.printing.run import print_part
from inkloop.report.remarks import remarks, stop_remarks, untrusted_remarks
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_controller.estimation.estimate_figures import TRANSFORMS
from support.places import SCENARIOS
from support.prints import quick_cuboid

CUBOID = quick_cuboid()

UNSEEN = pytest.mark.xfail(
    strict=True, reason="a cell that was not seen counts once it is unsure by 0.3 layers, not after untrusted_layers"
)


def run_folder(folder: Path, **overrides: Any) -> str:
    """Two layers of the cuboid."""
    print_part(Scenario.load(CUBOID, {"run.layers_max": 2, **overrides})).save(folder)
    return str(folder)


@pytest.mark.system
def test_compare_shows_each_run_and_writes_the_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = [run_folder(tmp_path / str(seed), seed=seed, label=f"seed {seed}") for seed in (1, 2)]
    picture = tmp_path / "both.png"
    assert main(["compare", *runs, "--out", str(picture)]) == 0
    shown = capsys.readouterr().out
    assert "seed 1" in shown
    assert "seed 2" in shown
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.system
def test_runs_of_one_label_are_distinguished_by_their_folders(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [run_folder(tmp_path / str(seed), seed=seed) for seed in (1, 2)]
    assert main(["compare", *runs, "--no-pictures"]) == 0
    shown = capsys.readouterr().out.replace("\n", "")
    assert all(run in shown for run in runs)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("inkloop.report.pictures.draw_comparison", lambda *_: [Path("both.png")])
        assert main(["compare", *runs, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (sorted(found["runs"]), found["pictures"]) == (runs, ["both.png"])


@pytest.mark.parametrize(("change", "message"), [({"nx": 14}, "14 x 12 cells"), ({"pitch_um": 250.0}, "of 250 µm")])
def test_runs_of_different_grids_are_refused(
    change: dict[str, float], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = [run_folder(tmp_path / "first"), run_folder(tmp_path / "second", grid=change)]
    assert main(["compare", *runs, "--out", str(tmp_path / "both.png")]) == 1
    error = capsys.readouterr().err
    assert message in error
    assert "12 x 12 cells of 263.256 µm" in error
    assert not (tmp_path / "both.png").exists()


def test_info_reports_how_a_run_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = run_folder(tmp_path / "run", seed=7)
    assert main(["info", folder]) == 0
    shown = capsys.readouterr().out
    for message in ("Cuboid, 8 x 8 droplets", "seed: 7", "after 2 layers", "mean error", "casadi", "wall time: "):
        assert message in shown


@pytest.mark.system
@pytest.mark.usefixtures("without_pictures")
def test_scans_that_were_corrected_are_reported_with_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario = SCENARIOS / "misaligned-scan.toml"
    for name, expected in (("true", True), ("false", False)):
        settings = [
            f"components.controller.register_scans={name}",
            "components.profiler.shift_std_um=0",
            "components.profiler.spot_radius_um=131.6",
            "run.layers_max=6",
        ]
        arguments = [word for setting in settings for word in ("--set", setting)]
        assert main(["run", str(scenario), "--out", str(tmp_path / name), "--no-compare", *arguments]) == 0
        shown = " ".join(capsys.readouterr().out.split())
        assert ("register the profiler with the printer" in shown) is expected
        found = re.search(r"shifted by ([\d.]+) µm along x .* the spot is (\d+) µm wide", shown)
        assert bool(found) is expected
        if found:
            assert float(found[1]) == pytest.approx(87.8, abs=4.0)
            assert float(found[2]) == pytest.approx(131.6, abs=15.0)


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
    shown = " ".join(capsys.readouterr().out.split())
    for message in (
        "ground that the scenario calls flat at 30.0 µm in the middle",
        "check the datum and the level of the profiler",
    ):
        assert message in shown
    assert main(["info", folder]) == 0
    assert "calls flat at 30.0 µm" in capsys.readouterr().out


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
        (512, 5, ("transposed against", "rows_along", "exchange {i} and {j} in `ports`", "fastest")),
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


def test_transform_of_a_sentence_is_that_of_the_controller() -> None:
    for number, name in enumerate(TRANSFORMS):
        if name:
            assert f"scans are {name} against" in stop_remarks(stopped_run(512, transform=number))[0]


def test_volumes_that_are_believed_are_those_of_the_scenario() -> None:
    scenario = "[components.controller]\nkind = 'LayerMpc'\nvolume_most = 2.0\n"
    assert "0.5 to 2 (volume_least, volume_most)" in stop_remarks(stopped_run(1024, scenario=scenario))[0]


def test_stop_of_a_print_that_went_on_is_reported_as_history() -> None:
    stopped = stopped_run(64).assign_attrs(stop_reason="stopped")
    (found,) = remarks(Result(stopped, {}))
    assert found.startswith("stopped: the scans do not show what was printed: nothing grew")
    (found,) = remarks(Result(stopped.assign_attrs(stop_reason="done"), {}))
    assert found.startswith("was stopped and resumed: nothing grew")


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

"""`inkloop identify` from a source to an ink file that prints."""

from __future__ import annotations

from datetime import date
from pathlib import Path

import numpy as np
import pytest
import tomlkit

from inkloop.cli import main
from inkloop.component import Ink
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_lab.identify import designs
from inkloop_lab.identify.candidates import candidates, conserving
from inkloop_lab.identify.experiments import Plan, perform, plant_scenario
from inkloop_lab.identify.identification import Comparison, Identification, compare, identify
from inkloop_lab.identify.ink_regression import identify_ink
from inkloop_lab.identify.ink_writer import write_ink
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.volume_area_coefficients import identify_volume_area
from inkloop_lab.models import LayerDeposition, VolumeAreaDeposition, YoungLaplaceDeposition
from inkloop_lab.models.layer_deposition import CELLS_OF_HEIGHTS
from inkloop_lab.score.board import surfaces
from support.logged_print import log, made_up, random_layers
from support.lying_scans.log import logged
from support.lying_scans.profiler import Profiler
from support.places import ROOT

RIVALS = ("Lu, regression", "spherical caps", "Wu, Chiu, fitted", "Young-Laplace")
TODAY = date(2026, 1, 1)
SMALL = ["--samples", "6", "--layers", "3", "--side", "16"]


def ink_of(path: Path):
    return [tomlkit.parse(path.read_text()).unwrap()["a"][f"h{k}_um"] for k in (1, 2, 3)]


@pytest.mark.long
def test_experiments_on_a_scenario_give_an_ink_that_prints(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """From a scenario whose printer has another ink than it states, to a print with the right one."""
    text = (ROOT / "scenarios" / "cuboid.toml").read_text()
    (tmp_path / "cuboid.toml").write_text(text)
    out = tmp_path / "mine.toml"
    true = [
        "components.printer.variation=0.0",
        "components.printer.h1_a_um=3.9",
        "components.printer.h2_a_um=0.5",
        "components.printer.h3_a_um=0.25",
    ]
    sets = [word for override in true for word in ("--set", override)]
    scenario = str(tmp_path / "cuboid.toml")
    assert main(["identify", scenario, *sets, *SMALL, "--out", str(out), "--runs", str(tmp_path / "kept")]) == 0
    assert ink_of(out) == pytest.approx([3.9, 0.5, 0.25], rel=1e-3, abs=0.0)
    assert out.with_suffix(".png").stat().st_size > 10_000
    output = capsys.readouterr().out
    assert all(name in output for name in ("droplet protocol", "Lu, regression", "Young-Laplace", "spherical caps"))
    scenario_text = text + f'\n[ink]\nfile = "{out.name}"\n'
    (tmp_path / "again.toml").write_text(scenario_text)
    assert Scenario.load(tmp_path / "again.toml").job().inks[0].h1 == pytest.approx(3.9e-6, rel=1e-3, abs=0.0)
    again = tmp_path / "again-ink.toml"
    assert main(["identify", str(tmp_path / "kept" / "layers"), "--out", str(again)]) == 0  # a run folder as a source
    assert ink_of(again) == pytest.approx([3.9, 0.5, 0.25], rel=1e-3, abs=0.0)


def test_plant_of_a_wider_reach_prints_from_the_ink_file(tmp_path: Path) -> None:
    """The printer of a scenario takes it from the file; the controller keeps its three heights."""
    far = (4.0e-6, 0.6e-6, 0.2e-6, 0.15e-6, 0.1e-6, 0.05e-6)
    record = made_up(LayerDeposition(), random_layers(14, 14, 3, 0, margin=3))
    plant = Comparison(conserving(2), LayerDeposition((far,)), None, ())
    ink = identify_ink([record], 0.0)
    write_ink(Identification((record,), (record,), 0.0, ink, None, None, (plant,), (), 2), tmp_path / "far.toml", TODAY)
    text = (ROOT / "scenarios" / "cuboid.toml").read_text().partition("[compare.")[0]
    (tmp_path / "case.toml").write_text(f'{text}\n[ink]\nfile = "far.toml"\n')
    scenario = Scenario.load(tmp_path / "case.toml", {"components.printer.variation": 0.0})
    pattern = np.zeros((12, 12), np.int32)
    pattern[6, 6] = 1
    _, after = surfaces(scenario, [pattern])
    assert after[6, 6:9] == pytest.approx([far[0], far[1], far[3]], rel=1e-6, abs=0.0)
    assert after[8, 7:9] == pytest.approx([far[4], far[5]], rel=1e-6, abs=0.0)
    assert scenario.job().inks[0].h1 == pytest.approx(4.4e-6, rel=1e-4, abs=0.0)


@pytest.mark.long
def test_logged_prints_are_pooled(tmp_path: Path) -> None:
    model = LayerDeposition()
    for number in range(2):
        log(tmp_path / f"p{number}", made_up(model, random_layers(16, 14, 2, number, margin=4), 0.2e-6, number))
    out = tmp_path / "ink.toml"
    assert main(["identify", str(tmp_path / "p0"), str(tmp_path / "p1"), "--out", str(out), "--reach", "2"]) == 0
    assert ink_of(out) == pytest.approx([4.4, 0.6, 0.2], abs=0.1)
    table = tomlkit.parse(out.read_text()).unwrap()
    plant = table["models"]["LayerDeposition"]
    heights = [plant[f"h{k}_a_um"] for k in range(1, 7)]
    assert np.dot(heights, CELLS_OF_HEIGHTS[:6]) == pytest.approx(7.6, rel=0.01, abs=0.0)
    assert heights == pytest.approx([4.4, 0.6, 0.2, 0.0, 0.0, 0.0], abs=0.1)
    assert len(table["identified"]["prints"]) == 2
    assert table["identified"]["noise_um"] == pytest.approx(0.2, rel=0.15, abs=0.0)


@pytest.mark.parametrize(
    ("kind", "pitch_um", "model", "options"),
    [
        ("VolumeAreaDeposition", 90.0, VolumeAreaDeposition, {"guard": True, "limit_gains": True}),
        ("YoungLaplaceDeposition", 42.3, YoungLaplaceDeposition, {"form": "linear", "cells_per_pitch": 4}),
    ],
)
def test_model_of_the_plant_explains_it_best(kind, pitch_um, model, options) -> None:
    overrides = {"grid.pitch_um": pitch_um, "components.printer": options}
    scenario = plant_scenario(kind, 0.02, overrides)
    records = perform(scenario, Plan(samples=0, layers=3, side=14))
    chosen = [one for one in candidates([Ink()], 0.02e-6) if one.name in RIVALS]
    rms = {type(one.model): one.score.rms for one in compare(chosen, records, 0.02e-6) if one.score}
    assert len(rms) == len(RIVALS)
    assert rms[model] < 0.8 * min(error for kind, error in rms.items() if kind is not model)


def test_areas_of_a_plant_that_reports_them_are_recorded() -> None:
    records = perform(plant_scenario("VolumeAreaDeposition", 0.0, {"grid.pitch_um": 90.0}), Plan(samples=6, layers=0))
    found = identify_volume_area(records, 0.0)
    assert found.area_known
    assert found.coefficients["mv_minus"] == pytest.approx(-20100.0, rel=1e-6, abs=0.0)


def test_experiments_are_the_same_for_the_same_seed(tmp_path: Path) -> None:
    def printed() -> PrintRecord:
        overrides = {"components.printer.variation": 0.2, "components.profiler.seed": 4}
        (record,) = perform(plant_scenario("LayerDeposition", 0.3, overrides), Plan(0, 2, 12, 5), tmp_path / "runs")
        return record

    assert np.array_equal(printed().measured, printed().measured)
    assert Result.load(tmp_path / "runs" / "layers").stop_reason == "done"


def test_displaced_log_gives_its_ink_and_a_sentence_on_screen_and_in_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inkloop_lab.identify.identification.compare", lambda *_: [])
    record = logged(Profiler(shift=(0.25, -0.1), noise=0.2), designs.layers(26, 22, 5, 3, margin=4))
    out = tmp_path / "ink.toml"
    assert main(["identify", str(log(tmp_path / "print", record)), "--out", str(out), "--no-pictures"]) == 0
    assert ink_of(out) == pytest.approx([4.4, 0.6, 0.2], abs=0.03)
    sentence = f"the scans of {tmp_path / 'print'} lie +0.25 cells along x and -0.10 along y"
    assert sentence in " ".join(capsys.readouterr().out.split())
    assert f"# Corrected: {sentence}" in out.read_text()


def test_log_that_does_not_show_its_patterns_is_refused_and_writes_no_ink(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = logged(Profiler(noise=0.5, turned="turned by 180"), designs.layers(22, 18, 3, 3, margin=4))
    out = tmp_path / "ink.toml"
    assert main(["identify", str(log(tmp_path / "print", record)), "--out", str(out)]) == 1
    error = " ".join(capsys.readouterr().err.split())
    assert "the scans are turned by 180 degrees: so the droplets explain" in error
    assert "add 180 to rotation_deg in its print.toml" in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere/"], "is no folder"),
        (["LayerDepositon"], "did you mean LayerDeposition"),
        (["LayerDeposition", "--side", "4", "--layers", "0"], "--side is 4"),
        (["a.toml", "b.toml"], "name folders, or one plant"),
        (["missing.toml"], "cannot be read"),
        (["missing.fmu"], "missing.fmu"),
        ([str(ROOT / "docs")], "holds neither print.toml"),
    ],
)
def test_invalid_sources_are_refused_with_a_message(arguments, message, tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["identify", *arguments]) == 1
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_ink_file_that_is_there_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "ink.toml"
    out.write_text("mine")
    assert main(["identify", "LayerDeposition", "--out", str(out)]) == 1
    assert "not overwritten" in capsys.readouterr().err
    assert out.read_text() == "mine"


def test_prints_of_different_pitch_or_unknown_noise_are_refused_with_a_message() -> None:
    record = made_up(LayerDeposition(), random_layers(12, 12, 1, 0))
    other = PrintRecord("other", 90e-6, record.pattern, record.measured)
    with pytest.raises(IdentificationError, match=r"other: pitch_um 90, made up: 263"):
        identify([record, other])
    with pytest.raises(IdentificationError, match=r"give it \(--noise-um\)"):
        identify([record])


def test_all_options_out_of_their_limits_are_named_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each by itself is taken at its limits: the message ends with the options that are beyond them."""
    (tmp_path / "mine").write_text("a file")
    (tmp_path / "prints" / "earlier").mkdir(parents=True)
    values = {"samples": (-1, 2001), "layers": (0, 201), "side": (11, 501), "noise-um": (-0.1, 1e6)}
    places = ("mine", "prints")
    for k in (0, 1):
        arguments = [f"--{name}={pair[k]}" for name, pair in values.items()] + ["--runs", str(tmp_path / places[k])]
        assert main(["identify", "LayerDeposition", "--out", str(tmp_path / "x.toml"), *arguments]) == 1
        error = " ".join(capsys.readouterr().err.split())
        for name, limits in {"samples": "0 to 2000", "layers": "1 to 200", "side": "12 to 500"}.items():
            assert f"--{name} is {values[name][k]}; expected {limits}" in error
        assert "--noise-um is" in error
        assert f"{places[k]}: is there already and not empty; name another, nothing is overwritten" in error

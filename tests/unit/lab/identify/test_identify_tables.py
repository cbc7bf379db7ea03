"""Tables and settings of `inkloop identify`: figures in the units of their headings, one row for each method."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop.errors import ScenarioError
from inkloop.report.terminal import Terminal
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_lab.identify import command, experiments
from inkloop_lab.identify.candidates import words
from inkloop_lab.identify.command import tables
from inkloop_lab.identify.droplet_protocol import ProtocolEstimate
from inkloop_lab.identify.experiments import Experiment, Plan, experiment_of, perform, plant_scenario
from inkloop_lab.identify.identification import Comparison, Identification
from inkloop_lab.identify.ink_regression import InkEstimate
from inkloop_lab.identify.one_step import Score
from inkloop_lab.identify.print_record import IdentificationError, PrintRecord
from inkloop_lab.identify.volume_area_coefficients import NAMES, VolumeAreaEstimate
from inkloop_lab.models import LayerDeposition, SuperpositionDeposition, VolumeAreaDeposition, YoungLaplaceDeposition
from support.places import SCENARIOS

ONE, TWO = np.array([[4e-6, 0.5e-6, 0.2e-6]]), np.array([[4e-6, 0.5e-6, 0.2e-6], [3e-6, 0.4e-6, 0.1e-6]])
PROTOCOL = ProtocolEstimate((4.1e-6, 0.6e-6, 0.3e-6), (0.1e-6, 0.02e-6, 0.003e-6), {"single": 30, "side": 15})
COEFFICIENTS = dict(zip(NAMES, (6700.0, -20100.0, 1000.0, -63400.0), strict=True))


def volume_area(*, known: bool) -> VolumeAreaEstimate:
    widths = dict(zip(NAMES, (10.0, 200.0, 3000.0, 40000.0), strict=True))
    errors = {"1": (0.051, 0.012), "2 on the sides": (0.0625, math.nan)}
    coefficients = {**COEFFICIENTS, "height_scale": 7.5e-6}
    return VolumeAreaEstimate(coefficients, widths, errors, {"1": 75, "2 on the sides": 74, "9": 1}, known)


def shown(heights: Any = ONE, comparisons: Sequence[Comparison] = (), **parts: Any) -> list[tuple[str, str, list[Any]]]:
    """Title, caption and rows of each table."""
    record = PrintRecord("it", 1e-4, np.zeros((1, 4, 3), np.int32), np.zeros((2, 4, 3)))
    covariance = np.diag(np.arange(1.0, 1.0 + heights.size) ** 2 * 1e-16)
    ink = InkEstimate(heights, covariance, 5, 0.3e-6, 0.125, 321)
    protocol, volume_area = parts.get("protocol"), parts.get("volume_area")
    found = Identification((record,), (record,), 0.3e-6, ink, protocol, volume_area, tuple(comparisons), ())
    return [
        (str(each.title), str(each.caption), list(zip(*(column.cells for column in each.columns), strict=True)))
        for each in tables(found)
    ]


@pytest.mark.parametrize(("name", "low", "high"), [("samples", 0, 2000), ("layers", 1, 200), ("side", 12, 500)])
def test_size_of_an_experiment_has_its_ends(name: str, low: int, high: int) -> None:
    options = argparse.Namespace(samples=75, layers=20, side=32, runs=None, noise_um=0.0)
    for number in (low, high):
        command._check(argparse.Namespace(**vars(options) | {name: number}))
    for number in (low - 1, high + 1):
        with pytest.raises(IdentificationError, match=f"^--{name} is {number}; expected {low} to {high}$"):
            command._check(argparse.Namespace(**vars(options) | {name: number}))


def test_heights_stand_in_micrometres_with_their_intervals_for_each_method_and_material() -> None:
    (title, caption, rows), _ = shown()
    assert title == "height that a droplet adds [µm], with 95 % intervals"
    assert caption.startswith("noise of a reading 0.3 µm; 321 growths; droplets vary by 12.5%")
    assert rows == [("regression over layers", "4.000 +- 0.026", "0.500 +- 0.051", "0.200 +- 0.077")]
    (_, _, rows), _ = shown(TWO, protocol=PROTOCOL)
    assert [row[0] for row in rows] == [
        "droplet protocol (30 single, 15 side)", "regression over layers, material A",
        "regression over layers, material B",
    ]  # fmt: skip
    assert rows[0][1:] == ("4.100 +- 0.100", "0.600 +- 0.020", "0.300 +- 0.003")
    assert rows[2][1:] == ("3.000 +- 0.103", "0.400 +- 0.129", "0.100 +- 0.154")


def test_coefficients_of_wu_and_chiu_are_per_micrometre_and_their_errors_in_percent() -> None:
    _, (_, caption, rows), _ = shown(volume_area=volume_area(known=True))
    assert caption == (
        "c 7.500 µm; mv_plus 0.0067 +- 0.0000, mv_minus -0.0201 +- 0.0002, ma_plus 0.0010 +- 0.0030, "
        "ma_minus -0.0634 +- 0.0400 per µm"
    )
    assert rows == [
        ("samples", "75", "74"),
        ("error of the mean", "5.1%", "6.2%"),
        ("its spread over groups of 3", "1.2%", "-"),
    ]
    _, (_, caption, _), _ = shown(volume_area=volume_area(known=False))
    assert caption == (
        "c 7.500 µm; mv_plus 0.0067 +- 0.0000, mv_minus -0.0201 +- 0.0002 per µm; no area was measured: ma_plus and "
        "ma_minus are the paper's"
    )


MODELS: Sequence[tuple[Any, str]] = (
    (LayerDeposition(((4.4e-6, 0.6e-6, 0.2e-6), (3e-6, 0.5e-6, 0.1e-6))), "4.4 0.6 0.2 | 3 0.5 0.1 µm"),
    (SuperpositionDeposition(((206.5e-6, 4.4e-6),)), "r 206.5, a 4.4 µm"),
    (VolumeAreaDeposition(90e-6, 7e-6, 6700.0, -20100.0, 1000.0, -63400.0), "c 7 µm, 0.0067 -0.0201 0.001 -0.0634 /µm"),
    (YoungLaplaceDeposition(42.3e-6, 30e-15, math.radians(55.0), "linear", 4), "30 pl, 55 degrees"),
)


@pytest.mark.parametrize(("model", "text"), MODELS, ids=[type(model).__name__ for model, _ in MODELS])
def test_models_are_told_in_units_of_people(model: Any, text: str) -> None:
    assert words(model) == text


def test_models_are_compared_in_their_order_beside_the_noise_of_two_scans() -> None:
    liquid = MODELS[3][0]
    comparisons = (
        Comparison("first", liquid, Score(0.5e-6, 0.025), ()),
        Comparison("refused", None, None, (), "too few"),
        Comparison("second", liquid, Score(0.25e-6, math.nan), ()),
    )
    *_, (_, caption, rows) = shown(comparisons=comparisons)
    assert "the noise of two scans alone is 0.424 µm" in caption  # 0.3 sqrt(2)
    assert rows == [
        ("first", "0.500", "2.5%", "30 pl, 55 degrees"),
        ("refused", "-", "-", ""),
        ("second", "0.250", "-", "30 pl, 55 degrees"),
    ]


OPTIONS = {"samples": 7, "layers": 3, "side": 16, "seed": 5, "runs": None, "noise_um": None, "reach": 2}


def options(*sources: str, **others: Any) -> argparse.Namespace:
    return argparse.Namespace(sources=list(sources), **{**OPTIONS, **others})


@pytest.fixture
def plans(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Scenario, plan and folder of the experiments that are asked for; nothing is printed."""
    asked: list[Any] = []

    def noted(scenario: Scenario, plan: Plan, runs: Path | None, on_layer: Any) -> list[PrintRecord]:
        asked.append((scenario, plan, runs))
        return []

    monkeypatch.setattr(command, "perform", noted)
    return asked


@pytest.mark.parametrize(("given", "noise_um"), [(None, 0.3), (0.0, 0.0), (0.7, 0.7)])
def test_experiments_on_a_kind_have_the_noise_and_the_plan_that_were_given(
    given: float | None, noise_um: float, plans: list[Any], tmp_path: Path
) -> None:
    _, nominal = command._records(options("LayerDeposition", noise_um=given, runs=tmp_path), {}, lambda *_: None)  # type: ignore[arg-type]
    ((scenario, plan, runs),) = plans
    assert scenario.tables.components["profiler"].options["noise_std_um"] == noise_um
    assert (plan, runs) == (Plan(samples=7, layers=3, side=16, seed=5), tmp_path)
    assert list(nominal) == [Ink()]


def test_nominal_inks_are_those_of_the_scenario_that_experiments_are_made_on(plans: list[Any]) -> None:
    _, nominal = command._records(options(str(SCENARIOS / "two-materials.toml")), {}, lambda *_: None)  # type: ignore[arg-type]
    assert list(nominal) == list(Scenario.load(SCENARIOS / "two-materials.toml").job().inks)
    assert len(nominal) == 2


def test_nominal_inks_of_a_run_are_those_of_its_scenario(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert list(command._nominal(tmp_path)) == [Ink()]  # a logged print states none
    (tmp_path / "result.nc").write_bytes(b"")
    for text, heights in (
        ("[ink.a]\nh1_um = 3.0\nh2_um = 0.5\nh3_um = 0.1\n", [3e-6]),
        ("[ink.b]\nh1_um = 2.0\nh2_um = 0.4\nh3_um = 0.3\n", [4.4e-6, 2e-6]),
    ):
        monkeypatch.setattr(Result, "load", lambda folder, text=text: SimpleNamespace(scenario_text=text))
        assert [ink.h1 for ink in command._nominal(tmp_path)] == pytest.approx(heights, rel=1e-12, abs=0.0)


def test_run_identifies_with_what_was_given_and_names_its_file_after_the_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[Any] = []
    record = PrintRecord("it", 1e-4, np.zeros((1, 4, 3), np.int32), np.zeros((2, 4, 3)))
    ink = InkEstimate(ONE, 1e-16 * np.eye(3), 5, 0.3e-6, 0.125, 321)

    def identified(*given: Any) -> Identification:
        asked.append(given)
        return Identification((record,), (record,), 0.3e-6, ink, None, None, (), ("the first note", "the second"))

    monkeypatch.setattr(command, "identify", identified)
    monkeypatch.setattr(command, "_records", lambda *_: ([record], (Ink(),)))
    monkeypatch.chdir(tmp_path)
    console = Terminal(as_json=True)
    assert command.run(options("some/case.toml", out=None, pictures=(), noise_um=0.5), {}, console) == 0
    (records, nominal, noise, seed, _, reach) = asked[0]
    assert (records, nominal, seed, reach) == ([record], (Ink(),), 5, 2)
    assert noise == pytest.approx(0.5e-6, rel=1e-12, abs=0.0)
    assert [path.name for path in tmp_path.iterdir()] == ["case-ink.toml"]
    told = capsys.readouterr()
    assert "note: the first note\nnote: the second\n" in told.err
    assert '"notes": [\n    "the first note",\n    "the second"\n  ]' in told.out


def test_folder_that_is_no_print_is_refused_with_the_name_that_was_meant(tmp_path: Path) -> None:
    (tmp_path / "prnt.toml").write_text("")
    with pytest.raises(IdentificationError, match=r"of a run; did you mean prnt\.toml\?"):
        command._read(tmp_path)


def test_experiment_takes_the_place_of_the_controller_and_leaves_the_plant() -> None:
    event = {"at_layer": 2, "action": "bias", "port": "profiler.measured_height", "value_um": 0.7}
    scenario = Scenario.load(SCENARIOS / "cuboid.toml", {"components.printer.variation": 0.125, "events": [event]})
    assert scenario.events
    made = {design: experiment_of(scenario, design, 30, Plan(9, 4, 22, 17)) for design in ("droplets", "layers")}
    for design, found in made.items():
        grid, components = found.tables.grid, found.tables.components
        assert (grid.nx, grid.ny, grid.pitch_um) == (30, 30, scenario.tables.grid.pitch_um)
        assert components["printer"].options["variation"] == 0.125
        assert components["controller"].kind == experiments.KIND
        assert found.tables.title == f"{scenario.tables.title}: {design}"
        assert int(found.job().mask.sum()) == 22**2  # a margin of four cells
        assert [found.tables.compare, found.tables.literature, found.events] == [{}, {}, []]
    assert made["droplets"].tables.components["controller"].options == {"design": "droplets", "design_seed": 17}
    expected = {"design": "layers", "design_seed": 17, "layers": 4}
    assert made["layers"].tables.components["controller"].options == expected


def test_experiments_need_a_controller_whose_place_they_take() -> None:
    class Loop(SimpleNamespace):
        pass

    none: Any = Loop(source="it.toml", ports={"printer": SimpleNamespace(outputs=())})
    with pytest.raises(ScenarioError, match="no component commands layers; experiments take the controller's place"):
        experiments._controllers(none)


def test_next_layer_is_commanded_once_the_last_one_is_printed_and_scanned() -> None:
    job = plant_scenario("LayerDeposition", 0.0).job()
    controller = Experiment(job, design="layers", layers=2)
    controller.initialize(0, {})

    def commanded(printed: int, scanned: int) -> tuple[int, int]:
        counts: Any = {"layers_printed": np.int32(printed), "layers_scanned": np.int32(scanned)}
        found = controller.do_step(0, 1, counts)
        return int(found["layer_command"]), int(found["status"])

    steps = [(0, -1), (0, 0), (0, 0), (1, 0), (1, 1), (2, 1), (2, 2)]
    assert [commanded(*each)[0] for each in steps] == [0, 1, 1, 1, 2, 2, 2]
    assert commanded(2, 2) == (2, 2)  # done


def test_layers_of_all_designs_are_counted_together() -> None:
    told: list[tuple[int, int]] = []
    scenario = plant_scenario("LayerDeposition", 0.0)
    records = perform(scenario, Plan(samples=1, layers=3, side=12), on_layer=lambda *each: told.append(each))
    assert [(record.name, len(record.pattern)) for record in records] == [("droplets", 2), ("layers", 3)]
    assert sorted(set(told)) == [(done, 5) for done in range(6)]
    assert records[1].shape == (20, 20)

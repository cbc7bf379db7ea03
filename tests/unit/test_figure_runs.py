"""Figures that the writers of pages keep of a run: name, unit and value; the runs are doubles."""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tools.figures import environment_times, gallery, identified_ink, own_part, pages, wider_stencil

import inkloop_lab
from inkloop_lab.models import LayerDeposition
from inkloop_lab.score.board import SEEDS
from support.toys import toy_result


@pytest.fixture
def record(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Path and content of the figures of the writers in this file."""
    path = tmp_path / "record.json"
    for module in (environment_times, identified_ink, own_part, wider_stencil, gallery):
        monkeypatch.setattr(module, "RECORD", path)
    return SimpleNamespace(path=path, read=lambda: json.loads(path.read_text(encoding="utf-8")))


def test_rows_are_kept_with_six_digits_under_their_names(tmp_path: Path) -> None:
    rows = [{"case": "a, b", "rms": 0.123456789, "seed": 1234567}, {"case": "µ", "rms": 2e-9, "seed": 2}]
    pages.write_csv(tmp_path / "rows.csv", rows)
    assert (tmp_path / "rows.csv").read_text(encoding="utf-8") == (
        'case,rms,seed\n"a, b",0.123457,1234567\nµ,2e-09,2\n'
    )
    assert pages.read_csv(tmp_path / "rows.csv")[1] == {"case": "µ", "rms": "2e-09", "seed": "2"}
    with pytest.raises(ValueError, match="dict contains fields not in fieldnames"):
        pages.write_csv(tmp_path / "rows.csv", [{"a": 1}, {"b": 2}])
    pages.write_json(tmp_path / "one.json", {"µ": [1.5, None]})
    assert pages.read_json(tmp_path / "one.json") == {"µ": [1.5, None]}
    assert "µ" in (tmp_path / "one.json").read_text(encoding="utf-8")


def test_marks_of_a_page_are_filled_and_missing_ones_are_refused() -> None:
    page = "a <!-- one -->old<!-- end --> b <!-- two -->kept<!-- end -->"
    assert pages.filled(page, {"one": "new"}) == "a <!-- one -->new<!-- end --> b <!-- two -->kept<!-- end -->"
    with pytest.raises(KeyError, match="the page has no mark four, three"):
        pages.filled(page, {"three": "", "one": "", "four": ""})


def test_times_of_the_environment_are_medians_in_milliseconds(record: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reset takes 1 s more with each seed, a layer 10 ms more."""
    clock, log = [0.0], list[Any]()
    mask = np.zeros((6, 5), np.bool_)
    mask[1:4, 2:5] = True

    class Env:
        job = SimpleNamespace(mask=mask)
        seed = 0

        def __init__(self, scenario: Path) -> None:
            log.append(scenario.name)

        def reset(self, *, seed: int) -> None:
            self.seed = seed
            clock[0] += 1.0 + seed

        def step(self, pattern: Any) -> None:
            assert pattern.shape == mask.shape
            assert not pattern[~mask].any()
            clock[0] += 0.01 * (1 + self.seed)

        def close(self) -> None:
            log.append("closed")

    def prints(entry: Any, plant: str, seeds: Any) -> Any:
        assert list(seeds) == [environment_times.SEED]
        return SimpleNamespace(mean=lambda key: f"{key} of {entry.name} on {plant}")

    monkeypatch.setattr(inkloop_lab, "LayerEnv", Env)
    monkeypatch.setattr(environment_times, "process_time", lambda: clock[0])
    monkeypatch.setattr(environment_times, "prints", prints)
    environment_times.run()
    found = record.read()
    assert found["layer_ms"] == pytest.approx(50.0, rel=1e-9, abs=0.0)
    assert found["reset_ms"] == pytest.approx(5000.0, rel=1e-9, abs=0.0)
    assert found["rms_um"] == {
        entry.name: [f"rms of {entry.name} on {plant}" for plant in environment_times.PLANTS]
        for entry in environment_times.ENTRIES
    }
    assert log == ["cylinder.toml", "closed"]
    for name in found["rms_um"]:
        found["rms_um"][name] = [1.234, 2.0, 3.0, 4.0]
    record.path.write_text(json.dumps(found), encoding="utf-8")
    (texts,) = environment_times.texts().values()
    assert {key: texts[key] for key in ("layer", "layers a second", "reset", "layers of a reset")} == {
        "layer": "50 ms", "layers a second": "0", "reset": "5000 ms", "layers of a reset": "100"
    }  # fmt: skip
    assert "| 1.23 | 2.00 | 3.00 | 4.00 |" in texts["plants"]


def test_stencils_are_kept_by_plant_with_heights_and_errors_in_micrometres(
    record: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    heights = [4.4e-6, 0.6e-6, 0.2e-6, 0.1e-6, 0.05e-6, 0.0]

    def stencils(plant: str) -> Any:
        wide = object.__new__(LayerDeposition)
        object.__setattr__(wide, "heights", [heights])
        score = SimpleNamespace(rms=0.25e-6)
        one = SimpleNamespace(model=wide, score=score)
        return {wider_stencil.WIDE: one, "not judged": SimpleNamespace(model=wide, score=None)}

    asked = []

    def prints(entry: Any, plant: str, seeds: Any) -> Any:
        asked.append((entry.name, plant, seeds))
        return SimpleNamespace(mean=lambda key: {"rms": 1.5}[key])

    monkeypatch.setattr(wider_stencil, "stencils", stencils)
    monkeypatch.setattr(wider_stencil, "prints", prints)
    wider_stencil.run()
    found = record.read()
    assert list(found) == list(wider_stencil.PLANTS)
    for plant, each in found.items():
        assert each["heights_um"] == pytest.approx([4.4, 0.6, 0.2, 0.1, 0.05, 0.0], rel=1e-9, abs=0.0)
        assert each["one_step_um"] == {wider_stencil.WIDE: pytest.approx(0.25, rel=1e-9, abs=0.0)}
        assert set(each["rms_um"].values()) == {1.5}
        assert list(each["rms_um"]) == [name for name, where, _ in asked if where == plant]
    assert {seeds for _, _, seeds in asked} == {SEEDS}
    (texts,) = wider_stencil.texts().values()
    table = texts["wider stencil"]
    assert table.startswith("\n| [µm] | " + " | ".join(wider_stencil.PLANTS) + " |")
    assert "| h4, h5, h6 of reach 2 | 0.10, 0.05, 0.00 |" in table
    assert f"| one step: {wider_stencil.WIDE} | 0.25 |" in table
    assert "| closed loop: search one layer ahead, reach 2 | 1.50 |" in table


def test_entries_of_a_stencil_take_its_heights() -> None:
    far = [4.0, 0.5, 0.25, 0.1, 0.0, 0.0]
    found = {entry.name: entry for entry in wider_stencil.entries(far)}
    assert found["search one layer ahead, reach 2"].options == {"heights_um": far}
    assert found["LayerMpc one layer ahead, Lu nominal"].options == {"horizon": 1}
    assert "LayerMpc, reach 2" not in found
    near = {entry.name: entry for entry in wider_stencil.entries([4.0, 0.5, 0.25, 0.0, 0.0, 0.0])}
    made: Any = near["LayerMpc, reach 2"].ink
    ink = made(None)
    assert (ink.h1, ink.h2, ink.h3) == pytest.approx((4e-6, 0.5e-6, 0.25e-6), rel=1e-9, abs=0.0)


def test_only_the_named_tables_of_the_ink_are_made_again(record: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    made = {name: (lambda name=name: {name: f"new {name}"}) for name in ("one", "two", "three")}
    monkeypatch.setattr(identified_ink, "PARTS", made)
    record.path.write_text('{"one": "old", "two": [["a", "b"], ["1", "2"]], "other": "kept"}')
    identified_ink.run("one")
    assert record.read() == {"one": "new one", "two": [["a", "b"], ["1", "2"]], "other": "kept"}
    (texts,) = identified_ink.texts().values()
    assert texts["two"] == "\n| a | b |\n|---:|---:|\n| 1 | 2 |\n"
    assert texts["one"] == "new one"
    identified_ink.run()
    assert record.read() == {"one": "new one", "two": "new two", "three": "new three", "other": "kept"}


def test_figures_of_the_bracket_are_those_of_its_last_surface() -> None:
    result = toy_result()
    target = result.dataset.target_height.values
    result.dataset["height"][-1] = result.dataset.height[-1] + 3e-6 * (target > 0)
    found = own_part.measured(result)
    assert found["misplaced_percent"] == pytest.approx(10.0, rel=1e-9, abs=0.0)  # 3 of 30 um on each cell of the part
    assert found["layers"] == 3
    assert set(found) == {"misplaced_percent", "mean_error_um", "mae_um", "std_um", "layers"}


def test_scenarios_of_the_gallery_are_run_by_name_and_those_that_are_gone_are_dropped(
    record: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("b", "a", "c"):
        (tmp_path / f"{name}.toml").write_text("")
    monkeypatch.setattr(gallery, "SCENARIOS", tmp_path)
    monkeypatch.setattr(gallery, "draw", lambda path: f"runs of {path.name}")
    monkeypatch.setattr(gallery, "measured", lambda stem, runs: f"{stem}: {runs}")
    record.path.write_text('{"a": "old", "gone": "old", "c": "old"}')
    gallery.run("b", "c")
    assert list(record.read().items()) == [("a", "old"), ("b", "b: runs of b.toml"), ("c", "c: runs of c.toml")]
    record.path.unlink()
    gallery.run()
    assert list(record.read()) == ["a", "b", "c"]

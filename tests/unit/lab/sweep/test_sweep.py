"""Studies without prints: what is printed next, and the files that come of it."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.errors import ResultError
from inkloop.report.terminal import Terminal
from inkloop.results import netcdf
from inkloop_lab.sweep.dataset import coordinate
from inkloop_lab.sweep.figures import METRICS
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import PointsPlan, seeds_wanted, standard_error
from inkloop_lab.sweep.report import _picture, report
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.tables import Until
from inkloop_lab.sweep.task import Bundle, Record, Task, failed
from support.sweeps import SCENARIO, Shuffled, record, study, swept

TWO_KEYS = """
[vary]
"components.controller.alpha" = [0.5, 0.8, 1.0]
components.controller.finish = ["even", "fast"]
"""


def alpha_of(task: Task) -> Record:
    """A print whose roughness is its alpha plus its seed, and which fails for "fast" with the third seed."""
    if task.replicate == 2 and task.overrides["components.controller.finish"] == "fast":
        return failed(task, "controller: gave up")
    return record(task, std=1e-6 * (task.overrides["components.controller.alpha"] + task.seed), layers=3.0)


def test_file_does_not_depend_on_the_order_or_on_interruptions(tmp_path: Path) -> None:
    own = study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 3\n")
    whole, _, _ = swept(own, tmp_path / "whole", Shuffled(alpha_of, slots=1))
    for seed in range(2):
        place = tmp_path / f"part-{seed}"
        engines = [Shuffled(alpha_of, 4, seed, interrupted_after=n) for n in (2, 5)] + [Shuffled(alpha_of, 2, seed)]
        for engine in engines:
            last, _, seen = swept(own, place, engine)
        assert sum(len(engine.begun) for engine in engines) < 18 + 2 * 4 + 1
        assert len(seen) == 18
        xr.testing.assert_identical(whole, last)
        assert (place / "sweep.nc").read_bytes() == (tmp_path / "whole" / "sweep.nc").read_bytes()


def test_sweep_is_labelled_by_keys_and_failing_prints_are_rows_with_their_error(tmp_path: Path) -> None:
    swept(study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 3\nfirst = 7\n"), tmp_path / "out", Shuffled(alpha_of))
    for sweep in (
        netcdf.read(tmp_path / "out/sweep.nc"),
        xr.load_dataset(tmp_path / "out/sweep.nc", engine="h5netcdf"),
    ):
        fast = sweep.sel({"components.controller.alpha": 0.8, "components.controller.finish": "fast"})
        assert fast["std"].dims == ("seed",)
        np.testing.assert_allclose(fast["std"], [7.8e-6, 8.8e-6, np.nan], rtol=1e-12)
        assert fast["error"].values.tolist() == ["", "", "controller: gave up"]
        assert fast["status"].values.tolist() == [1, 1, 5]
        assert sweep["status"].attrs["flag_meanings"].split()[5] == "failed"
        assert sweep["std"].attrs["units"] == "m"
        assert sweep["seed"].values.tolist() == [7, 8, 9]


@pytest.mark.system
def test_page_has_every_point_and_error_and_texts_of_users_are_no_html(tmp_path: Path) -> None:
    own = study(tmp_path, f'title = "alpha <i> & finish"\n{TWO_KEYS}[seeds]\ncount = 3\n')
    found, plan, _ = swept(own, tmp_path / "out", Shuffled(alpha_of))
    assert report(own, found, plan, tmp_path / "out", ("png",), Terminal(io.StringIO()), is_whole=True) == 3
    text = (tmp_path / "out/study.html").read_text(encoding="utf-8")
    assert "<h1>alpha &lt;i&gt; &amp; finish</h1>" in text
    assert "<i>" not in text
    assert "18 of 18 prints" in text
    assert "3 failed" in text
    assert "<li>3: controller: gave up</li>" in text
    rows = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td>.*</tr>", text)
    assert rows[0] == ("alpha 0.5, finish even", "2.50 ± 0.58")
    assert len(rows) == 6
    assert "<p>Smallest std: alpha 0.5, finish even: 2.50 ± 0.58 µm" in text
    pictures = re.findall(r'<h2>\w.*?</h2><p><a href=".*?"><img src="(.*?)"', text)
    assert len(pictures) == text.count("<img") > 1
    assert all((tmp_path / "out" / name).is_file() for name in pictures)
    assert "<caption>mean over the seeds, ± its standard error</caption>" in text


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_page_links_to_pictures_that_browsers_do_not_show(suffix: str) -> None:
    shown = _picture(Path("out", f"main-effects.{suffix}"))
    assert f'<a href="main-effects.{suffix}">' in shown
    assert ("<img" in shown) == (suffix != "pdf")


def test_print_without_a_whole_file_is_printed_again(tmp_path: Path) -> None:
    own = study(tmp_path, TWO_KEYS)
    whole, _, _ = swept(own, tmp_path / "out", Shuffled(alpha_of))
    found = tmp_path / "out/prints/00002-0000.json"
    killed = found.parent / "inkloop-part-1-x/content"  # a kill between writing and renaming
    killed.mkdir(parents=True)
    found.rename(killed / found.name)
    engine = Shuffled(alpha_of)
    again, _, _ = swept(own, tmp_path / "out", engine)
    assert engine.begun == [(2, 0)]
    xr.testing.assert_identical(whole, again)
    found.write_text("{")
    with pytest.raises(ResultError, match=r"00002-0000\.json: is no record of a print .*; delete it to print again"):
        swept(own, tmp_path / "out", engine)


def test_changed_study_is_refused_and_more_seeds_are_not(tmp_path: Path) -> None:
    swept(study(tmp_path, TWO_KEYS), tmp_path / "out", Shuffled(alpha_of))
    more = study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 2\n")
    assert len(swept(more, tmp_path / "out", Shuffled(alpha_of))[2]) == 12
    with pytest.raises(ResultError, match=r"changed since then: vary, sample or seeds\.first"):
        swept(study(tmp_path, TWO_KEYS.replace("0.8", "0.7")), tmp_path / "out", Shuffled(alpha_of))


def test_until_stops_where_the_standard_error_says(tmp_path: Path) -> None:
    text = f'{TWO_KEYS}[seeds]\ncount = 3\nmax = 60\nuntil = {{ metric = "std", standard_error_um = 0.1 }}\n'

    def scattered(task: Task) -> Record:
        scale = task.overrides["components.controller.alpha"] * (
            1 + 9 * (task.overrides["components.controller.finish"] == "fast")
        )
        return record(task, std=1e-6 * scale * np.random.default_rng(task.seed).normal())

    own = study(tmp_path, text)
    few, _, _ = swept(own, tmp_path / "few", Shuffled(scattered, slots=1))
    for engine in (Shuffled(scattered, slots=9, seed=4, interrupted_after=60), Shuffled(scattered, slots=9, seed=5)):
        many, _, _ = swept(own, tmp_path / "many", engine)
    xr.testing.assert_identical(few, many)
    counts = []
    for values in few["std"].values.reshape(6, -1):
        known = 1e6 * values[np.isfinite(values)]
        counts.append(len(known))
        assert standard_error(known) <= 0.1 or len(known) == 60
        assert standard_error(known[: len(known) // 2]) > 0.1 or len(known) == 3
    assert max(counts) == 60 > min(counts)


def test_file_says_what_it_holds_and_keeps_the_surfaces_of_earlier_parts(tmp_path: Path) -> None:
    def surface(task: Task) -> Record:
        found = replace(record(task, std=2e-6, layers=3.0), height=np.full((12, 12), 1.0 * task.point))
        return replace(found, wall_s=2.5) if task.replicate else failed(task, "gave up")

    own = study(tmp_path, f'title = "Two"\n{TWO_KEYS}[seeds]\ncount = 2\n[keep]\nmaps = "final"\n')
    swept(own, tmp_path / "out", Shuffled(surface, interrupted_after=5))
    swept(own, tmp_path / "out", Shuffled(surface))
    sweep = netcdf.read(tmp_path / "out/sweep.nc")
    assert (sweep.attrs["title"], sweep.attrs["study"]) == ("Two", own.text)
    assert sweep.attrs["scenario"] == SCENARIO.read_text()
    for axis in ("x", "y"):
        np.testing.assert_allclose(sweep[axis], np.arange(12) * own.scenario.tables.grid.pitch, rtol=1e-12)
    assert sweep["height"].dims[-2:] == ("x", "y")
    assert np.isnan(sweep["height"][:, :, 0]).all()
    np.testing.assert_array_equal(sweep["height"][:, :, 1, 4, 5].values.ravel(), np.arange(6.0))
    np.testing.assert_array_equal(sweep["wall_s"][:, :, 1], 2.5)
    units = {name: sweep[name].attrs["units"] for name in ("std", "layers", "wall_s", "height")}
    assert units == {"std": "m", "layers": "1", "wall_s": "s", "height": "m"}
    assert sorted(set(METRICS) & set(sweep)) == ["layers", "std"]
    assert sweep["std"].attrs["long_name"].startswith("standard deviation of the error")


def test_surfaces_that_are_too_large_for_one_file_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = study(tmp_path, f'{TWO_KEYS}[keep]\nmaps = "final"\n')
    monkeypatch.setattr("inkloop_lab.sweep.dataset.MAPS_MAX", 6 * 144 * 8)
    swept(own, tmp_path / "out", Shuffled(alpha_of))
    monkeypatch.setattr("inkloop_lab.sweep.dataset.MAPS_MAX", 6 * 144 * 8 - 1)
    monkeypatch.setattr("inkloop_lab.sweep.dataset.GIGA", 1e3)
    with pytest.raises(ResultError, match=r'keep.maps: all surfaces have 6\.9 GB; write keep.maps = "all"'):
        swept(own, tmp_path / "out", Shuffled(alpha_of))


def reported(own: Study, worth: Any, folder: Path) -> tuple[dict[str, Any], str, str]:
    """Figures, screen and page of a report."""
    found, plan, _ = swept(own, folder, Shuffled(worth))
    figures, shown = dict[str, Any](), io.StringIO()
    console = Terminal(shown)
    console.result = lambda **values: figures.update(values)
    report(own, found, plan, folder, (), console, is_whole=True)
    return figures, shown.getvalue(), (folder / "study.html").read_text(encoding="utf-8")


def test_page_has_more_points_than_the_screen_and_both_texts_and_the_summary_the_best(tmp_path: Path) -> None:
    alphas = [0.5 + 0.01 * n for n in range(30)]
    own = study(tmp_path, f'# <mine>\n[vary]\n"components.controller.alpha" = {alphas}\n')

    def alpha(task: Task) -> Record:
        return record(task, std=1e-6 * task.overrides["components.controller.alpha"], layers=3.0)

    figures, shown, page = reported(own, alpha, tmp_path / "out")
    assert (len(figures["points"]), figures["indices"], figures["interrupted"]) == (30, None, False)
    assert "the 24 points of 30 with the smallest std" in shown
    assert page.count("<tr><td>alpha ") == 30
    assert "30 of 30 prints of " in page
    assert "none failed." in page
    assert "&lt;mine&gt;" in page
    assert page.count("<details>") == 2
    assert page.partition("The scenario")[2].count("[components.controller]") == 1
    best = "smallest std: alpha 0.5: 0.50 µm"
    assert best in shown
    assert best in (tmp_path / "out" / "summary.txt").read_text(encoding="utf-8")


def test_five_errors_are_shown_the_most_frequent_first(tmp_path: Path) -> None:
    own = study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 2\n")
    names = "abbccdefg" + 3 * "a"
    figures, shown, page = reported(
        own, lambda task: failed(task, names[2 * task.point + task.replicate]), tmp_path / "out"
    )
    lines = [line for line in shown.splitlines() if "failed: " in line]
    assert lines == [
        "4 prints failed: a", "2 prints failed: b", "2 prints failed: c", "1 print failed: d", "1 print failed: e",
    ]  # fmt: skip
    assert page.count("<li>") == 7
    assert figures["failed"] == 12
    assert {(each["prints"], each["failed"]) for each in figures["points"]} == {(2, 2)}


def test_indices_of_a_report_are_by_metric_and_key_and_its_page_has_the_points_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("inkloop_lab.sweep.sensitivity.RESAMPLES", 8)
    keys = ("components.controller.alpha", "components.printer.variation", "components.profiler.noise_std_um")
    lines = "".join(f'"{key}" = {{ uniform = [0.1, 0.9] }}\n' for key in keys)
    text = f'[sample]\nmethod = "sobol-indices"\npoints = 8\nseed = 3\n{lines}'

    def plant(task: Task) -> Record:
        return record(
            task, std=1e-6 * task.overrides[keys[0]] + 3e-6 * task.overrides[keys[2]], layers=3.0 + task.point
        )

    own = study(tmp_path, text)
    figures, _, page = reported(own, plant, tmp_path / "out")
    sweep, *_ = swept(own, tmp_path / "out", Shuffled(plant))
    assert set(figures["indices"]) == {"std", "layers"}
    for metric, by_key in figures["indices"].items():
        assert list(by_key) == list(keys)
        for key, found in by_key.items():
            own_values = sweep.sel(metric=metric, key=key)
            assert found == {name: float(own_values[name]) for name in found}
            assert len(found) == 8
    assert figures["indices"]["std"][keys[1]]["first_order"] == pytest.approx(0.0, abs=1e-9)
    assert page.count("<table>") == 2
    varied = study(tmp_path, f'[vary]\n"components.controller.finish" = ["even", "fast"]\n{text}')
    assert reported(varied, plant, tmp_path / "varied")[0]["indices"] is None


def test_folder_of_another_scenario_or_version_or_of_no_study_is_refused(tmp_path: Path) -> None:
    own = study(tmp_path, TWO_KEYS)
    bundle = Bundle.of(own.scenario.text, SCENARIO)
    StudyFolder(tmp_path, own, bundle)
    with pytest.raises(ResultError, match="changed since then: the scenario or one of its files"):
        StudyFolder(tmp_path, own, replace(bundle, text=f"# seen\n{bundle.text}"))
    state = json.loads((tmp_path / "study.json").read_text())
    for found, message in (({**state, "schema_version": 3}, "schema version is 3"), ({}, "is no record of a study")):
        (tmp_path / "study.json").write_text(json.dumps(found))
        with pytest.raises(ResultError, match=message):
            StudyFolder(tmp_path, own, bundle)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("components.profiler.noise_std_um", "um"),
        ("components.profiler.scan_duration_s", "s"),
        ("components.printer.variation", "1"),
        ("components.printer.mv_plus_per_um", "1/um"),
        ("components.printer.layers", "1"),
    ],
)
def test_key_has_the_unit_of_its_name(key: str, unit: str) -> None:
    assert coordinate(key, "sample", [1.0, 2.0]).attrs["units"] == unit


def test_values_that_are_no_numbers_are_texts() -> None:
    assert coordinate("k", "k", ["even", [1, 2], True]).values.tolist() == ["even", "[1, 2]", "true"]
    assert coordinate("k", "k", [True, False]).values.tolist() == [True, False]
    assert coordinate("k", "k", [1, 2.5]).values.tolist() == [1.0, 2.5]


@pytest.mark.parametrize(
    ("stds", "goal", "most", "more"),
    [
        ((1.0, 3.0), 1.0, 99, 0),  # standard error 1
        ((1.0, 3.0), 0.9, 99, 1),  # 2 / 0.9^2 = 2.5 prints
        ((1.0, 3.0), 0.5, 99, 2),  # 8 prints, no more than doubled
        ((1.0, 3.0, 1.0, 3.0), 0.4, 99, 5 - 1),  # standard error 0.577: 8.3 prints, no more than doubled
        ((1.0, 3.0, 1.0, 3.0), 0.5, 99, 2),  # 5.3 prints
        ((1.0, 3.0, 1.0, 3.0), 0.4, 6, 2),
        ((1.0, 3.0, 1.0, 3.0), 0.4, 4, 0),
        ((1.0, None), 0.1, 99, 0),  # a scatter that nobody knows
        ((None, None), 0.1, 99, 0),
        ((1.0, 3.0, None), 0.5, 99, 3),  # 8 prints that do not fail
    ],
)
def test_further_seeds_are_those_that_the_scatter_asks_for(
    stds: tuple[float | None, ...], goal: float, most: int, more: int
) -> None:
    metrics: list[Any] = [{} if std is None else {"std": std * 1e-6, "layers": std} for std in stds]
    records = [Record(0, number, "done" if each else "failed", each) for number, each in enumerate(metrics)]
    assert seeds_wanted(records, Until(metric="std", standard_error_um=goal), most) == more
    assert seeds_wanted(records, Until(metric="layers", standard_error=goal), most) == more


def test_plan_counts_the_seeds_that_it_adds(tmp_path: Path) -> None:
    alpha = "components.controller.alpha"
    until = '[seeds]\ncount = 2\nmax = 9\nuntil = { metric = "std", standard_error_um = 0.5 }\n'
    plan = PointsPlan(study(tmp_path, f'[vary]\n"{alpha}" = [0.5, 0.8]\n{until}'))
    tasks = list(plan.begin())
    assert [(*task.key, task.overrides[alpha]) for task in tasks] == [
        (0, 0, 0.5),
        (0, 1, 0.5),
        (1, 0, 0.8),
        (1, 1, 0.8),
    ]
    assert plan.total == 4
    assert not plan.after(record(tasks[3], std=3e-6))
    further = plan.after(record(tasks[2], std=1e-6))
    added = [(task.key, task.seed - tasks[2].seed, task.overrides) for task in further]
    assert added == [((1, 2), 2, {alpha: 0.8}), ((1, 3), 3, {alpha: 0.8})]
    assert plan.total == 6

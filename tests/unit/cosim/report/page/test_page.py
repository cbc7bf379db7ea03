"""The page of a run as a file: maps to half a step, numbers as in summary.txt, nothing that loads or runs by itself."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.printing.run import print_part
from inkloop.printing.so_far import RunFolder
from inkloop.report import run_report
from inkloop.report.page import page
from inkloop.report.page.live import Feed
from inkloop.results.checkpoint import LAYERS_FOLDER
from inkloop.results.result import COMPARE_FOLDER, Result
from inkloop.scenario.file import Scenario
from support.once_per_run import once
from support.pages import HOSTILE, content_of, heights_of, unfinished
from support.prints import quick_cuboid

HALF_A_STEP_UM = 0.005 * (1.0 + 1e-9)


def print_two(folder: Path) -> None:
    """Four layers of the cuboid and of an open loop, with a title and a label that are markup; and its page."""
    scenario = Scenario.load(quick_cuboid(), {"run.layers_max": 4, "title": HOSTILE, "label": f"closed {HOSTILE}"})
    print_part(scenario).save(folder)
    print_part(scenario.variant("open loop")).save(folder / COMPARE_FOLDER / "open-loop")
    run_report.write(folder, pictures=[])
    assert main(["report", str(folder), "--html", "--quiet"]) == 0


def run_folder() -> Path:
    return once(print_two)


def text() -> str:
    return (run_folder() / page.FILE).read_text(encoding="utf-8")


def test_maps_that_take_too_much_become_means_of_blocks() -> None:
    runs, log = run_report.load_runs(run_folder()), Path("none.log")
    whole = len(page.content_within(runs, log, 10_000_000))
    texts = len(page.content_within(runs, log, 1))  # one block is left
    room = texts + (whole - texts) // 2
    small = page.content_within(runs, log, room)
    assert len(small) <= room < whole
    assert {run["block"] for run in json.loads(small)["runs"]} <= {2, 3, 4}


def test_numbers_are_those_of_the_summary() -> None:
    shown = content_of(text())
    summary = (run_folder() / "summary.txt").read_text(encoding="utf-8")
    numbers = [line.split() for line in summary.splitlines()]
    rows = shown["tables"]["table"]["rows"]
    assert len(rows) >= 2
    for row in rows:
        assert row[1:] in [line[-len(row) + 1 :] for line in numbers]
    assert all(" ".join(remark.split()) in " ".join(summary.split()) for remark in shown["remarks"])


def test_page_loads_nothing_and_runs_its_own_scripts_only() -> None:
    script = re.compile("<script[^>]*>(.*?)</script>", re.DOTALL)
    data, *scripts = script.findall(text())
    markup = script.sub("", text())
    (policy,) = re.findall('<meta http-equiv="Content-Security-Policy" content="(.*?)">', markup)
    rules = {rule.split()[0]: set(rule.split()[1:]) for rule in policy.split(";")}
    assert rules["default-src"] == {"'none'"}
    assert "connect-src" not in rules
    assert data.startswith("{")
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    assert rules["script-src"] == {f"'sha256-{digest}'" for digest in digests}
    assert len(scripts) == 1 + len(page.SCRIPTS)
    assert not re.search(r"\s(on\w+|src|href)\s*=", markup)
    for name in ("page.html", "page.css", *page.SCRIPTS):
        assert not re.search(
            r"https?:|@import|url\(|innerHTML|insertAdjacentHTML|eval\(|new Function", page.own_file(name)
        )


def test_markup_in_titles_and_labels_stays_text() -> None:
    assert HOSTILE not in text()
    shown = content_of(text())
    assert shown["texts"]["title"] == HOSTILE
    assert shown["runs"][0]["name"] == f"closed {HOSTILE}"
    names = {trace["name"] for figure in ("curves", "distribution") for trace in shown[figure]["data"]}
    assert not [name for name in names if "<" in name]  # Plotly knows some markup


@pytest.mark.parametrize("form", ["html", pytest.param("pdf", marks=pytest.mark.long)])
def test_run_that_has_not_ended_is_reported_with_the_layers_it_has(form: str, tmp_path: Path) -> None:
    unfinished(quick_cuboid(), tmp_path / "run", 2)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert main(["report", str(tmp_path / "run"), f"--{form}", "--quiet"]) == 0
    written = tmp_path / "run" / f"report.{form}"
    assert {path: path.read_bytes() for path in before} == before
    assert {path for path in tmp_path.rglob("*") if path.is_file()} - before.keys() == {written}
    if form == "html":
        shown = content_of(written.read_text(encoding="utf-8"))
        whole = print_part(Scenario.load(quick_cuboid(), {"run.layers_max": 2})).dataset
        assert np.abs(heights_of(shown["runs"][0])[:3] - whole.height.values * 1e6).max() <= HALF_A_STEP_UM
        assert "has not ended" in shown["texts"]["state"]
    else:
        assert written.read_bytes().startswith(b"%PDF")


def test_result_of_a_run_that_has_not_ended_is_that_of_its_layers(tmp_path: Path) -> None:
    unfinished(quick_cuboid(), tmp_path, 2)
    reader = RunFolder(tmp_path)
    found = reader.runs()
    assert reader.runs()[next(iter(found))] is next(iter(found.values()))  # nothing has changed, nothing is read
    result: Any = next(iter(found.values()))
    whole: Result = print_part(Scenario.load(quick_cuboid()))
    shared = result.dataset.sizes["layer"]
    for name in ("height", "measured_height", "pattern", "target_height", "mask", "mean_error"):
        known, expected = result.dataset[name], whole.dataset[name]
        rows = slice(None, shared) if "layer" in known.dims else slice(None)
        assert np.array_equal(known.values, expected.values[rows]), name
    for path in (tmp_path / LAYERS_FOLDER).glob("0002*.npz"):
        path.unlink()
    (after,) = reader.runs().values()  # a resumed run prints this layer again
    assert (shared, after.dataset.sizes["layer"]) == (3, 2)
    np.testing.assert_array_equal(after.dataset.height, result.dataset.height[:2])


def test_layers_of_a_run_that_has_not_ended_stay_on_disk_until_they_are_used(tmp_path: Path) -> None:
    """No file of theirs is kept open; where the run ends meanwhile, and removes them, that is said."""
    unfinished(quick_cuboid(), tmp_path, 2)
    (result,) = RunFolder(tmp_path).runs().values()
    maps = [values for values in result.dataset.data_vars.values() if values.dims == ("layer", "x", "y")]
    assert len(maps) >= 4
    assert not any(values.variable._in_memory for values in maps)
    for values in maps:
        whole = values.values
        np.testing.assert_array_equal(values[-1, 2:5], whole[-1, 2:5])
        np.testing.assert_array_equal(values[:, 3, [1, 4]], whole[:, 3, [1, 4]])
        np.testing.assert_array_equal(values[1:], whole[1:])
    reader = RunFolder(tmp_path)
    source: Any = SimpleNamespace(stamps=lambda: "as before", runs=reader.runs)
    feed = Feed(source, lambda: "", tmp_path / "bench.log", 2)
    before = feed.content()
    assert before
    assert "problem" not in before
    for path in (tmp_path / LAYERS_FOLDER).glob("[0-9]*.npz"):
        path.unlink()
    with pytest.raises(ResultError, match="is gone: the run has ended in the meantime"):
        _ = maps[0].values
    gone, source.stamps = feed.content(), reader.stamps
    assert gone
    assert "is gone: the run has ended in the meantime" in gone["problem"]
    seen_again = feed.content()
    assert seen_again
    assert "no layer is finished yet" in seen_again["problem"]

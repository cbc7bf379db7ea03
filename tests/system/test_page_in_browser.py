"""The page of a run in a browser without a network: no message, the numbers of the run, clicks, markup that stays text.

All of it is `long`: a browser costs seconds of processor time.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.printing.run import print_part
from inkloop.report import run_report
from inkloop.report.page import page
from inkloop.results.result import COMPARE_FOLDER, Result
from inkloop.scenario.file import Scenario
from support.browser import Browser, browser, needs_chromium
from support.once_per_run import once
from support.pages import HOSTILE
from support.prints import quick_cuboid

pytestmark = [pytest.mark.long, needs_chromium]

IS_DRAWN = "document.body && document.body.dataset.layers"
SLOW = ("--set", "run.real_time_factor=20")
HALF_A_STEP_UM = 0.005 * (1.0 + 1e-9)


def print_two(folder: Path) -> None:
    """The cuboid and an open loop, with a title and a label that are markup, and their page."""
    scenario = Scenario.load(quick_cuboid(), {"title": HOSTILE, "label": f"closed {HOSTILE}"})
    print_part(scenario).save(folder)
    print_part(scenario.variant("open loop")).save(folder / COMPARE_FOLDER / "open-loop")
    run_report.write(folder, pictures=[])
    assert main(["report", str(folder), "--html", "--quiet"]) == 0


def shown(tab: Browser, expression: str) -> Any:
    return tab.value(f"document.{expression}")


def read_out(tab: Browser) -> tuple[list[int], int, float]:
    """Cell, layer and height [um] of the read-out."""
    text = shown(tab, "getElementById('readout').textContent")
    found = re.match(r"Cell \((\d+), (\d+)\) .* layer (\d+): height (-?[\d.]+) µm", text)
    assert found is not None, text
    return [int(found[1]), int(found[2])], int(found[3]), float(found[4])


def click_cell(tab: Browser, place: str, i: int, j: int, pitch_mm: float) -> None:
    """Click the middle of a cell of a map, found by the axes of the chart."""
    tab.value(f"document.querySelector('{place}').scrollIntoView({{block: 'center'}})")
    x, y = tab.value(
        f"""(() => {{
            const plot = document.querySelector('{place}'), box = plot.getBoundingClientRect();
            const {{ xaxis, yaxis }} = plot._fullLayout;
            return [box.left + xaxis._offset + xaxis.d2p({i * pitch_mm}),
                    box.top + yaxis._offset + yaxis.d2p({j * pitch_mm})];
        }})()"""
    )
    tab.click(x, y)


@pytest.mark.parametrize("width", [1400, 400])
def test_page_opens_without_a_network_and_without_a_message(width: int) -> None:
    folder = once(print_two)
    with browser() as tab:
        tab.open((folder / page.FILE).as_uri(), width=width)
        tab.wait(IS_DRAWN)
        assert tab.messages == []
        assert shown(tab, "documentElement.scrollWidth") <= width
        rows = tab.value("[...document.querySelectorAll('#table tbody tr')].map((row) => row.innerText.split('\\t'))")
        lines = [line.split() for line in (folder / "summary.txt").read_text(encoding="utf-8").splitlines()]
        assert len(rows) >= 2
        for row in rows:
            assert row[1:] in [line[-len(row) + 1 :] for line in lines]
        assert shown(tab, "getElementById('title').textContent") == HOSTILE
        assert shown(tab, "title").startswith(HOSTILE)  # which the script in it would have changed
        assert shown(tab, "querySelectorAll('main b').length") == 0
        assert tab.value("fetch('https://example.org').then(() => 'loaded', () => 'refused')") == "refused"


def test_clicks_and_slider_show_the_heights_of_the_run() -> None:
    folder = once(print_two)
    runs = [result.dataset for result in run_report.load_runs(folder).values()]
    pitch_mm = float(runs[0].attrs["pitch"]) * 1e3
    with browser() as tab:
        tab.open((folder / page.FILE).as_uri())
        tab.wait(IS_DRAWN)

        def assert_read(run: int, layer: int, i: int, j: int) -> None:
            tab.wait(f"document.getElementById('readout').textContent.startsWith('Cell ({i}, {j})')")
            cell, number, height = read_out(tab)
            assert (cell, number) == ([i, j], layer)
            assert abs(height - float(runs[run].height.values[layer, i, j]) * 1e6) <= HALF_A_STEP_UM

        last = runs[0].sizes["layer"] - 1
        click_cell(tab, "#error", 4, 7, pitch_mm)
        assert_read(0, last, 4, 7)
        tab.value(
            "(() => { const s = document.getElementById('layer'); s.value = 2; "
            "s.dispatchEvent(new Event('input')); })()"
        )
        tab.wait("document.getElementById('layer-number').textContent.startsWith('2 ')")
        click_cell(tab, "#surface", 8, 3, pitch_mm)
        assert_read(0, 2, 8, 3)
        click_cell(tab, "#finals > :nth-child(2)", 5, 5, pitch_mm)
        assert_read(1, runs[1].sizes["layer"] - 1, 5, 5)
        assert tab.messages == []


COMMAND = "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"


def watched(folder: Path) -> tuple[subprocess.Popen[str], str]:
    """A process that serves a run folder, and its address."""
    words = [sys.executable, "-c", COMMAND, "watch", str(folder), "--port", "0"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:\d+/", line)
    assert found is not None, line
    return process, found[0]


def printing(folder: Path) -> subprocess.Popen[str]:
    """A process that prints the cuboid, slowly enough to be watched."""
    words = ["run", str(quick_cuboid()), "--out", str(folder), "--no-compare", "--no-pictures", *SLOW]
    return subprocess.Popen([sys.executable, "-c", COMMAND, *words], stdout=subprocess.DEVNULL, text=True)


def test_live_page_shows_layers_and_neither_kill_nor_stall_of_the_watcher_changes_the_print(tmp_path: Path) -> None:
    print_ = printing(folder := tmp_path / "run")
    while not (folder / "layers" / "0000.npz").exists():
        assert print_.poll() is None
    killed, _ = watched(folder)
    stalled, _ = watched(folder)
    stalled.send_signal(signal.SIGSTOP)
    killed.kill()
    process, url = watched(folder)
    with browser() as tab:
        tab.open(url)
        tab.wait(IS_DRAWN)
        first = int(shown(tab, "body.dataset.layers"))
        assert print_.wait() == 0
        tab.wait("document.getElementById('state').textContent.includes('ended the print')")
        tab.wait(f"Number(document.body.dataset.layers) >= {first}")
        count = int(shown(tab, "body.dataset.layers"))
        assert tab.messages == []
    process.send_signal(signal.SIGINT)
    assert process.wait() == 0
    stalled.kill()
    for each in (killed, stalled, process):
        each.communicate()
    found = Result.load(folder).dataset
    assert count == found.sizes["layer"]
    alone = print_part(Scenario.load(quick_cuboid())).dataset
    for name in ("height", "measured_height", "pattern", "estimated_height", "droplets_a"):
        assert np.array_equal(found[name].values, alone[name].values), name

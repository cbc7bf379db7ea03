"""A covered profiler, or a part on the bed, ends a print on devices before anything is jetted."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from inkloop.bench.commands import emulation_of
from inkloop.cli import main
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.emulated_bench import EmulatedBench
from support.benches.bench_run import BLOCK, FAST, emulated, write


def printing(path: Path, channel: str, *words: str) -> int:
    """The exit code of a run at a channel, into the next free folder."""
    out = path.parent / f"run-{len(list(path.parent.glob('run-*')))}"
    return main(["run", str(path), "--set", f"bench.channel={channel}", "--no-pictures", "--out", str(out), *words])


def test_covered_profiler_ends_dry_run_and_print_with_nothing_jetted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, BLOCK.replace("dropout_rate = 0.02", "dropout_rate = 1.0"))
    with emulated(path) as (_, channel):
        assert main(["bench", "dry-run", str(path), "--set", f"bench.channel={channel}"]) == 1
        assert "the scan: 0% of its cells are valid; needs 50% (bench.valid_share)" in capsys.readouterr().err
        assert printing(path, channel) == 1
        assert "the first scan: 0% of its cells are valid" in capsys.readouterr().err
    assert '"pass"' not in (tmp_path / "run-0" / "master.journal").read_text()


def test_bed_with_a_part_is_asked_about_and_printed_on_if_a_person_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, heap = write(tmp_path), np.zeros((12, 11))
    heap[3:8, 2:9] = 50e-6
    with EmulatedBench(emulation_of(Scenario.load(path)).parameters | FAST, surface=heap) as bench:
        assert printing(path, bench.channel) == 1
        assert re.search(r"the first scan shows something on the bed: 3\d of 1\d\d cells", capsys.readouterr().err)
        assert '"pass"' not in (tmp_path / "run-0" / "master.journal").read_text()
        assert printing(path, bench.channel, "--on-part", "--set", "run.layers_max=1") == 0
    assert Result.load(tmp_path / "run-1").dataset.sizes["layer"] == 2

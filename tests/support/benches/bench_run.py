"""Prints on the emulator in a separate process, and the same prints with the FMUs."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.bench.commands import emulation_of
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_hardware.emulated_bench import EmulatedBench

FAST = {"pass_ms": 2, "scan_ms": 2, "move_ms": 2, "home_ms": 2, "gate_ms": 1}
FMUS = {"components.printer.kind": "LayerDeposition", "components.profiler.kind": "ProfileSensor"}
PATIENCE_S = 600.0
"""Ends a test that hangs; every wait is for an event."""
COMMAND = [sys.executable, "-c", "import sys; from inkloop.cli import main; sys.exit(main(sys.argv[1:]))"]

BLOCK = """
title = "block"
seed = 3

[grid]
nx = 12
ny = 11

[part]
shape = "cuboid"
size_x_um = 1700.0
size_y_um = 1700.0
height_um = 15.0

[process]
passes = 4
pass_order = "diagonal"
pass_rotation = 1

[bench]
interface = "slcan"
bitrate = 500000
cure_ms = 2
silence_s = 1.0    # a busy machine is no fault of the bench
grace_s = 5.0
answer_s = 20.0

[components.controller]
kind = "LayerMpc"
horizon = 1

[components.printer]
kind = "hardware.printer"
variation = 0.2
variation_kind = "per_droplet"

[components.profiler]
kind = "hardware.profiler"
noise_std_um = 0.1
resolution_um = 0.1
dropout_rate = 0.02
"""
TWO_INKS = BLOCK + "\n[support]\nmargin_cells = 2\n\n[ink.b]\nh1_um = 3.9\nh2_um = 0.5\nh3_um = 0.15\n"


def write(folder: Path, text: str = BLOCK) -> Path:
    path = folder / "block.toml"
    path.write_text(text, encoding="utf-8")
    return path


@contextmanager
def emulated(
    path: Path, overrides: Mapping[str, Any] | None = None, **times: float
) -> Iterator[tuple[EmulatedBench, str]]:
    """The bench of a scenario, and the override that leads a run to it."""
    emulation = emulation_of(Scenario.load(path, overrides))
    with EmulatedBench(emulation.parameters | FAST | times, surface=emulation.surface) as bench:
        yield bench, bench.channel


def printed_with_fmus(path: Path, overrides: Mapping[str, Any] | None = None) -> Result:
    return print_part(Scenario.load(path, {**FMUS, **(overrides or {})}))


def assert_same_print(bench: Result, fmus: Result) -> None:
    """Patterns and measured maps to the bit, layer by layer."""
    assert bench.stop_reason == fmus.stop_reason == "done"
    for name in ("pattern", "measured_height", "valid", "estimated_height", "droplets_a", "droplets_b"):
        np.testing.assert_array_equal(bench.dataset[name], fmus.dataset[name], err_msg=name)


def started(*words: str) -> subprocess.Popen[str]:
    """An inkloop command in a process of its own; a run draws no pictures."""
    plain = ["--no-pictures"] if words[0] == "run" else []
    return subprocess.Popen([*COMMAND, *words, *plain], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)


def wait_for_word(log: Path, word: str, running: subprocess.Popen[str]) -> None:
    """Returns when a word stands in the log of the devices."""
    end = time.monotonic() + PATIENCE_S
    while not (log.exists() and word in log.read_text()):
        assert running.poll() is None, running.communicate()[0]
        assert time.monotonic() < end, f"{word!r} was never printed"
        time.sleep(0.01)

"""The threads of the core under the thread sanitizer: programs in C plan and estimate with one and with four."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.fmus.controller_values import controller_values
from support.places import ROOT

CORE = ROOT / "controller" / "core"
FMUS = ROOT / "fmus"
PLANNING, ESTIMATING = (ROOT / "tests" / "c" / f"{work}_in_threads.c" for work in ("planning", "estimating"))
ELSEWHERE = ("inkloop_core.c", "parallel_none.c")  # the interface for Python, and no threads
FLAGS = ("-std=c11", "-O2", "-g", "-ffp-contract=off", "-fsanitize=thread")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")

pytestmark = [
    pytest.mark.long,
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="gcc for Linux is not installed"),
]


def run(driver: Path, core: Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """The driver on this core; skipped where gcc has no thread sanitizer."""
    compiler: list[str | Path] = ["gcc", "-fsanitize=thread", "-xc", "-", "-o", folder / "empty"]
    empty = subprocess.run(compiler, input="int main(void) {}", capture_output=True, text=True, check=False)
    if empty.returncode or subprocess.run([folder / "empty"], capture_output=True, check=False).returncode:
        pytest.skip("gcc with its thread sanitizer is not installed, or does not run on this kernel")
    sources = [path for path in sorted(core.rglob("*.c")) if path.name not in ELSEWHERE]
    program = folder / driver.stem
    sources.append(FMUS / "layer_deposition" / "layer_map.c")
    places = sorted({f"-I{path.parent}" for path in (*sources, FMUS / "deposition" / "pass_colour.h")})
    command: list[str | Path] = [
        "gcc",
        *FLAGS,
        *WARNINGS,
        *places,
        f"-I{controller_values()}",
        driver,
        *sources,
        "-lm",
        "-lpthread",
        "-o",
        program,
    ]
    subprocess.run(command, check=True)
    settings = {"TSAN_OPTIONS": "halt_on_error=1"}
    return subprocess.run([program], env=os.environ | settings, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("driver", [PLANNING, ESTIMATING], ids=lambda driver: driver.stem)
def test_four_threads_do_what_one_does_and_share_nothing_unguarded(driver: Path, tmp_path: Path) -> None:
    done = run(driver, CORE, tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr[-5000:]
    assert "ThreadSanitizer" not in done.stderr


def test_race_between_tiles_would_be_detected(tmp_path: Path) -> None:
    """A counter that all threads share, put in on purpose."""
    core = tmp_path / "core"
    shutil.copytree(CORE, core)
    sweep = core / "search" / "tiled_sweep.c"
    text, begins = sweep.read_text(), "    const Share *share = handed;\n"
    assert text.count(begins) == 1
    sweep.write_text(text.replace(begins, f"    static long counted;\n    counted++;\n{begins}"))
    done = run(PLANNING, core, tmp_path)
    assert done.returncode != 0
    assert "data race" in done.stderr

"""The loop of a system of FMUs by OMSimulator, from the .ssp as `inkloop export ssp` writes it.

Its result files of the form of Dymola (.mat) hold every bit; its CSV holds 12 digits.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from inkloop.exchange.ssp import archive
from inkloop.exchange.ssp.system import System
from support.masters.loops import TIME_MAX_S, Loop
from support.masters.other_programs import OMSIMULATOR

RESULTS = "results.mat"


def by_omsimulator(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """All its communication points. Raises RuntimeError with its errors."""
    archive.write(replace(system, stop_s=TIME_MAX_S), "1.0", folder / "loop.ssp")
    points = round(TIME_MAX_S / system.step_s)
    options = (f"--stopTime={points * system.step_s}", f"--intervals={points}", "--stripRoot=true")
    done = subprocess.run(
        [OMSIMULATOR.command, *options, "--tempDir=.", f"--resultFile={RESULTS}", "loop.ssp"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    errors = [line.removeprefix("error:").strip() for line in done.stdout.splitlines() if line.startswith("error:")]
    if errors or done.returncode:
        raise RuntimeError("; ".join(errors or done.stdout.splitlines()[-1:]))
    yield from _rows(folder / RESULTS, loop, system)


def _rows(path: Path, loop: Loop, system: System) -> Iterator[tuple[int, Any]]:
    """(layers_printed, numbers) of each point; it writes a point again where an output has changed in it."""
    content = loadmat(path, chars_as_strings=False)  # per name, a column each: letters; which table, its row and sign
    names = ["".join(letters).rstrip("\0 ") for letters in content["name"].T]
    place = dict(zip(names, content["dataInfo"].T.tolist(), strict=True))
    times = content["data_2"][0]
    last = np.flatnonzero(np.diff(times, append=np.inf) > 0.5 * system.step_s)

    def at_points(name: str) -> Any:
        data, row, *_ = place[f"{loop.part}.{name}"]
        series = np.sign(row) * content[f"data_{data}"][abs(row) - 1]
        return series[last] if data == 2 else np.full(last.size, series[0])

    columns = [at_points(name) for name in loop.scalars(system)]
    for printed, *numbers in zip(at_points("layers_printed"), *columns, strict=True):
        yield int(printed), np.array(numbers)

"""The loop of a system of FMUs by programs that start from the files of `inkloop export ssp`: Maestro (INTO-CPS) and
OMSimulator, whose result files of the form of Dymola (.mat) hold every bit; its CSV holds 12 digits.
"""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat

from inkloop.exchange.ssp import ssd
from inkloop.exchange.ssp.folder import CONFIGURATION, MULTI_MODEL, write
from inkloop.exchange.ssp.system import System, Wire
from inkloop.master.wiring import Transfer
from support.masters.java_programs import MAESTRO
from support.masters.loops import TIME_MAX_S, Loop
from support.masters.other_programs import OMSIMULATOR

CSV, MAT = "outputs.csv", "results.mat"


def by_maestro(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """All its rows. Java prints the shortest decimals that read back as the same number: the text loses no bit."""
    files, system = folder / "maestro", system if system.wires else _with_a_wire(system)
    write(replace(system, stop_s=TIME_MAX_S), "maestro", files)
    words = ("import", "sg1", "--interpret", "-output=out", "--fmu-search-path=.")
    output = MAESTRO.run("org.intocps.maestro.Main", *words, CONFIGURATION, MULTI_MODEL, folder=files).stdout
    if not (files / "out" / CSV).is_file():
        causes = re.findall(r"^Caused by: .*|Error in simulation: .*|logStatusError .*", output, re.MULTILINE)
        raise RuntimeError("; ".join(causes or output.splitlines()[-1:]))
    yield from _rows_of_csv(files / "out" / CSV, f"{{{loop.part}}}.{loop.part}", loop.scalars(system))


def _with_a_wire(system: System) -> System:
    """Maestro runs nothing that is not connected: a second instance listens to the first."""
    (first,) = system.parts
    second = replace(first, name="second")
    wire = Wire((first.name, "volume_scale"), (second.name, "volume_factor"), 1.0, 0.0, Transfer())
    return replace(system, parts=[first, second], wires=[wire])


def _rows_of_csv(path: Path, part: str, names: Sequence[str]) -> Iterator[tuple[int, Any]]:
    """(layers_printed, numbers) of each row. Names hold commas and are not quoted: each begins with a brace."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    columns = {name: number for number, name in enumerate(re.split(r",(?=\{)", head))}
    wanted = [columns[f"{part}.{name}"] for name in names]
    printed = columns[f"{part}.layers_printed"]
    for line in lines:
        texts = line.split(",")
        yield int(texts[printed]), np.array([float(texts[column]) for column in wanted])


def by_omsimulator(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """All its communication points. Raises RuntimeError with its errors."""
    ssd.write(replace(system, stop_s=TIME_MAX_S), "1.0", folder / "loop.ssp")
    points = round(TIME_MAX_S / system.step_s)
    options = (f"--stopTime={points * system.step_s}", f"--intervals={points}", "--stripRoot=true")
    done = subprocess.run(
        [OMSIMULATOR.command, *options, "--tempDir=.", f"--resultFile={MAT}", "loop.ssp"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    errors = [line.removeprefix("error:").strip() for line in done.stdout.splitlines() if line.startswith("error:")]
    if errors or done.returncode:
        raise RuntimeError("; ".join(errors or done.stdout.splitlines()[-1:]))
    yield from _rows_of_mat(folder / MAT, loop, system)


def _rows_of_mat(path: Path, loop: Loop, system: System) -> Iterator[tuple[int, Any]]:
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

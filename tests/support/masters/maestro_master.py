"""The loop of a system of FMUs by Maestro (INTO-CPS), started from the files of `inkloop export ssp --to maestro`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.exchange.ssp import maestro
from inkloop.exchange.ssp.command import write_folder
from inkloop.exchange.ssp.system import System, Wire
from inkloop.master.wiring import Transfer
from support.masters.java_programs import MAESTRO
from support.masters.loops import TIME_MAX_S, Loop

RESULTS = "outputs.csv"


def by_maestro(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """All its rows. Java prints the shortest decimals that read back as the same number: the text loses no bit."""
    files, system = folder / "maestro", system if system.wires else _with_a_wire(system)
    write_folder(replace(system, stop_s=TIME_MAX_S), "maestro", files)
    words = ("import", "sg1", "--interpret", "-output=out", "--fmu-search-path=.")
    output = MAESTRO.run(
        "org.intocps.maestro.Main", *words, maestro.CONFIGURATION, maestro.MULTI_MODEL, folder=files
    ).stdout
    if not (files / "out" / RESULTS).is_file():
        causes = re.findall(r"^Caused by: .*|Error in simulation: .*|logStatusError .*", output, re.MULTILINE)
        raise RuntimeError("; ".join(causes or output.splitlines()[-1:]))
    yield from _rows(files / "out" / RESULTS, f"{{{loop.part}}}.{loop.part}", loop.scalars(system))


def _with_a_wire(system: System) -> System:
    """Maestro runs nothing that is not connected: a second instance listens to the first."""
    (first,) = system.parts
    second = replace(first, name="second")
    wire = Wire((first.name, "volume_scale"), (second.name, "volume_factor"), 1.0, 0.0, Transfer())
    return replace(system, parts=[first, second], wires=[wire])


def _rows(path: Path, part: str, names: Sequence[str]) -> Iterator[tuple[int, Any]]:
    """(layers_printed, numbers) of each row. Names hold commas and are not quoted: each begins with a brace."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    columns = {name: number for number, name in enumerate(re.split(r",(?=\{)", head))}
    wanted = [columns[f"{part}.{name}"] for name in names]
    printed = columns[f"{part}.layers_printed"]
    for line in lines:
        texts = line.split(",")
        yield int(texts[printed]), np.array([float(texts[column]) for column in wanted])

"""The loop of a system of FMUs by Maestro (INTO-CPS), started from the files of `inkloop export-ssp --to maestro`."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.ssp import maestro
from inkloop.ssp.command import write_folder
from inkloop.ssp.system import System
from java_programs import MAESTRO
from six_by_six import SHAPE, TIME_MAX_S

RESULTS = "outputs.csv"


def by_maestro(system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """All its rows. Java prints the shortest decimals that read back as the same number: the text loses no bit."""
    files = folder / "maestro"
    write_folder(replace(system, stop_s=TIME_MAX_S), "maestro", files, system.name)
    words = ("import", "sg1", "--interpret", "-output=out", "--fmu-search-path=.")
    said = MAESTRO.run(
        "org.intocps.maestro.Main", *words, maestro.CONFIGURATION, maestro.MULTI_MODEL, folder=files
    ).stdout
    if not (files / "out" / RESULTS).is_file():
        causes = re.findall(r"^Caused by: .*|Error in simulation: .*|logStatusError .*", said, re.MULTILINE)
        raise RuntimeError("; ".join(causes or said.splitlines()[-1:]))
    yield from _rows(files / "out" / RESULTS, system)


def _rows(path: Path, system: System) -> Iterator[tuple[int, Any]]:
    """(layers_printed, height) of each row. Names hold commas and are not quoted: each begins with a brace."""
    head, *lines = path.read_text(encoding="utf-8").splitlines()
    columns = {name: number for number, name in enumerate(re.split(r",(?=\{)", head))}
    cells = [columns[f"{{printer}}.printer.{name}"] for name in system.part("printer").scalars("height")]
    printed = columns["{printer}.printer.layers_printed"]
    for line in lines:
        texts = line.split(",")
        yield int(texts[printed]), np.reshape([float(texts[cell]) for cell in cells], SHAPE)

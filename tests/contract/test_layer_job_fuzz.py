"""The laws around every FMI call, as for the other FMUs, on a print in one block."""

from __future__ import annotations

import random
import re
import shutil
from pathlib import Path

import fmpy
import numpy as np
import pytest

import fmu_library
from contract.test_fmu_fuzz import feed
from layer_jobs import MODEL, unpacked
from node_bench import FIRMWARE

SCENARIO = ("cuboid", "components.controller.horizon=1", "run.layers_max=20")
INPUTS = 100


def written_table(form: str, path: Path) -> Path:
    """As for the other models, with the token and the grid of the block."""
    folder = unpacked(form, *SCENARIO)
    description = fmpy.read_model_description(folder)
    (library,) = (file for file in (folder / "binaries").rglob("*") if file.is_file())
    built = fmu_library.Library(MODEL, form, library, folder / "resources")
    fmu_library.write_table(built, path, resizable=False)
    lines = path.read_text().splitlines()
    lines[0] = f"{lines[0].split()[0]} 0 12 12"
    lines[3] = description.guid if form == "fmi2" else description.instantiationToken
    starts = {v.name: v.start for v in description.modelVariables if v.causality == "parameter"}
    for number, line in enumerate(lines[4:], 4):
        words = line.split()
        words[5] = starts.get(words[0], words[5])
        lines[number] = " ".join(words)
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.skipif(not shutil.which("gcc"), reason="gcc is not installed")
@pytest.mark.parametrize("form", ["fmi2", "fmi3-fixed"])
def test_calls_do_what_the_standard_says_or_change_nothing(form, tmp_path) -> None:
    program = fmu_library.program(tmp_path, "calls", "gcc", (), others=[FIRMWARE / "fuzz" / "replay.c"])
    generator = random.Random(form)
    said = feed(program, written_table(form, tmp_path / "table.txt"), [generator.randbytes(400) for _ in range(INPUTS)])
    found = re.findall(r"^steps (\d+) layers (\d+) refusals (\d+)$", said, re.MULTILINE)
    steps, layers, refusals = np.array(found, int).sum(axis=0)
    assert len(found) == INPUTS
    assert min(steps, layers) > INPUTS
    assert refusals > 10 * INPUTS

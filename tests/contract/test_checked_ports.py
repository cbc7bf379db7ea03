"""The ports that the check of options reports are those of the component that is made from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job, Ports
from inkloop.components import catalog, devices
from inkloop.components.fmu_parameters import FORMS
from inkloop.components.kind import Bench
from inkloop.testing import job
from support.fmus.amplifier import build

JOB = job()
MASK = np.pad(np.ones((3, 5), np.bool_), 1)
OTHER_GRID = replace(JOB, nx=5, ny=7, target_height=np.where(MASK, 2e-5, 0.0), mask=MASK)
CASES = {
    **{f"{model} {form}": (model, {"fmi": form}) for model in catalog.FMU_MODELS for form in FORMS},
    **{kind: (kind, {}) for kind in catalog.PYTHON_KINDS if kind != catalog.MAP_FOLDER},
    **{kind: (kind, {}) for kind in devices.KINDS},
    "MapFolder": ("MapFolder", {"folder": "maps"}),
    "Shadow": ("Shadow", {}),
    "Shadow from the job": ("Shadow", {"start": "job", "plant": "SuperpositionDeposition"}),
}


@pytest.mark.parametrize("grid", [JOB, OTHER_GRID], ids=["grid", "other grid"])
@pytest.mark.parametrize(("kind", "options"), CASES.values(), ids=CASES)
def test_ports_as_checked_are_those_of_the_component(kind: str, options: dict[str, object], grid: Job) -> None:
    checked = catalog.check(kind, grid, options)
    assert not checked.errors
    made = checked.make(Bench())
    assert Ports.of(made) == checked.ports
    made.terminate()


@pytest.mark.parametrize(
    "options",
    [
        {"kind": "Fmu"},
        {"kind": "Fmu", "ports": {"height": {"variable": "x", "gain": 2.0}, "status": "count"}},
        {"kind": "PlainPlant", "pattern_input": "x", "height_output": "y"},
        {"kind": "Shadow", "plant": "Fmu", "pattern_input": "x", "height_output": "y"},
    ],
    ids=["alone", "with mapped ports", "without the handshake", "in a shadow"],
)
@pytest.mark.compiled
@pytest.mark.parametrize("fmi", [2, 3])
def test_ports_of_a_foreign_fmu_are_those_of_the_component(fmi: int, options: dict[str, Any], tmp_path: Path) -> None:
    three = replace(JOB, nx=3, ny=1, target_height=np.zeros((3, 1)), mask=np.ones((3, 1), np.bool_))
    own = {name: value for name, value in options.items() if name != "kind"}
    checked = catalog.check(options["kind"], three, {"file": str(build(tmp_path, fmi)), **own})
    assert not checked.errors
    made = checked.make(Bench())
    assert Ports.of(made) == checked.ports
    made.terminate()

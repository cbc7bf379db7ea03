"""The plug-in makes a test of each law, for components that keep them and for those that do not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

COMPONENTS = """
import numpy as np
from inkloop.component import Job, Port

class Still:
    def __init__(self, job: Job) -> None:
        self.inputs, self.outputs = (), (Port("height", "m", (job.nx, job.ny)),)
    def initialize(self, time_ns, inputs):
        return {"height": np.zeros(self.outputs[0].shape)}
    do_step = lambda self, time_ns, step_ns, inputs: self.initialize(time_ns, inputs)
    def terminate(self): pass

class Flat(Still):
    def initialize(self, time_ns, inputs):
        return {"height": np.zeros(3)}
"""


def laws_of(kind: str, folder: Path) -> subprocess.CompletedProcess[str]:
    (folder / "components.py").write_text(COMPONENTS)
    command = [sys.executable, "-m", "pytest", "-q", "-rs", "-p", "inkloop.pytest_plugin", "--inkloop-component", kind]
    return subprocess.run(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": str(folder)}, capture_output=True, text=True, check=False
    )


def test_component_that_keeps_the_laws_passes_each_of_them(tmp_path: Path) -> None:
    run = laws_of("components:Still", tmp_path)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "6 passed, 1 skipped" in run.stdout
    assert "cannot be resumed" in run.stdout


def test_component_that_breaks_a_law_is_told_which_and_how(tmp_path: Path) -> None:
    run = laws_of("components:Flat", tmp_path)
    assert run.returncode == 1
    assert "outputs are as declared from the start on" in run.stdout
    assert "initialize returns height as ((3,), 'float64'); declared is ((7, 5), 'float64')" in run.stdout


def test_unknown_component_is_named(tmp_path: Path) -> None:
    run = laws_of("components:Stil", tmp_path)
    assert run.returncode == 1
    assert "components:Stil" in run.stdout

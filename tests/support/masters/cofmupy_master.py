"""The loop of a system of FMUs by cofmupy, in an environment of its own: it pins an FMPy that is older than ours."""

from __future__ import annotations

import json
import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.exchange.ssp.system import System
from support.masters.loops import TIME_MAX_S, Loop

_PROGRAM = """
import contextlib, json, sys
from cofmupy import Coordinator

configuration, names, step_s, steps = json.load(sys.stdin)
coordinator = Coordinator()
with contextlib.redirect_stdout(sys.stderr):
    coordinator.start(configuration)
for number in range(steps):
    coordinator.do_step(step_s)
    values = [value for name in names for value in coordinator.get_variable(tuple(name))]
    print(json.dumps(values), flush=True)
"""
_REFUSED = re.compile(r"fmi\d[GS]et(Real|Float64) failed|Variable type \w+ not supported")
"""By the FMU, or by ctypes where it sets an array as one number."""


class RealsOnly(Exception):
    """It read or set a variable of another type, or an array, as one real number."""


class Cofmupy:
    """The Python of an environment with cofmupy, in the folder `COFMUPY_HOME`."""

    @property
    def python(self) -> Path:
        return Path(os.environ["COFMUPY_HOME"], "bin", "python")

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        if not os.environ.get("COFMUPY_HOME"):
            return "COFMUPY_HOME names no environment with cofmupy 1.0, which pins a FMPy that is too old for inkloop"
        return "" if self.python.is_file() else f"COFMUPY_HOME: there is no {self.python}"


COFMUPY = Cofmupy()


def by_cofmupy(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """Wired by its configuration. Raises RealsOnly."""
    fmus = [
        {
            "id": part.name,
            "path": str(part.file),
            "initialization": {
                scalar: number
                for name, value in part.values.items()
                for scalar, number in zip(part.scalars(name), _values(part.scalars(name), value), strict=True)
            },
        }
        for part in system.parts
    ]
    connections = [
        {"source": {"id": wire.source[0], "variable": source}, "target": {"id": wire.target[0], "variable": target}}
        for wire in system.wires
        for source, target in system.pairs(wire)
    ]
    configuration = {"fmus": fmus, "connections": connections, "cosim_method": "jacobi", "iterative": False}
    names = [(loop.part, name) for name in ("layers_printed", *loop.scalars(system))]
    given = json.dumps([configuration, names, system.step_s, round(TIME_MAX_S / system.step_s)])
    run = subprocess.run([COFMUPY.python, "-c", _PROGRAM], input=given, capture_output=True, text=True, cwd=folder)
    if run.returncode:
        last = run.stderr.splitlines()[-1]
        raise (RealsOnly if _REFUSED.search(last) else RuntimeError)(last)
    for line in run.stdout.splitlines():
        printed, *numbers = json.loads(line)
        yield int(printed), np.array(numbers)


def _values(scalars: tuple[str, ...], value: Any) -> list[Any]:
    """A number for each scalar, or the whole array for its name."""
    numbers: list[Any] = np.ravel(value).tolist()
    return numbers if len(scalars) == len(numbers) else [numbers]

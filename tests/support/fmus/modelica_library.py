"""Compiles and simulates models of models/InkLoop with rumoca, reads maps out of its results, and has JModelica compile
them, where there is one.

What rumoca 0.10.2 takes: `Session.load(".../package.mo", model=...)` for a class of the library (the folder alone
fails), `Session(roots=[folder above it]).loads(text, model=...)` for a text that uses it. `simulate(t=(start, stop),
dt=...)` keeps the moments before and after every event too. What it refuses or gets wrong, and the library avoids:

- arrays of records, local records in functions, loop ranges that depend on inputs (`max(1, i - 1):n`);
- loops in a `when` algorithm (in a function they are fine), reading a variable there after it was assigned;
- `assert` under a `when` whose condition is true for one event iteration only: it is not looked at;
- results of functions assigned to array elements, `(x[1], x[2]) := f()`; locals of functions without a value;
- `max(abs(array))` in a function, of an array that another function has filled;
- a constraining clause's modifiers after a redeclaration (MLS 7.3.2 keeps them): they are repeated;
- a connected input that lacks the start value of its output is looked at with 0 in the first instant;
- functions, types and partial packages as the model to compile; a block whose inputs are read with `pre`, alone.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import rumoca

from support.places import ROOT

LIBRARY = ROOT / "models/InkLoop"
_REFERENCES = LIBRARY / "Resources/Reference/InkLoop"
REFERENCE_MODELS = sorted(
    ".".join(path.parent.relative_to(_REFERENCES).parts) for path in _REFERENCES.rglob("comparisonSignals.txt")
)
"""Models with reference results, by their names after `InkLoop.`."""
MODELS = [
    f"{folder}.{path.stem}"
    for folder in ("Examples", "Validation")
    for path in sorted((LIBRARY / folder).glob("*.mo"))
    if path.stem != "package"
]
"""All models that run by themselves, by their names after `InkLoop.`."""


class Simulation:
    """Trajectories of one run."""

    def __init__(self, result: rumoca.Result) -> None:
        self._result = result
        self.end = float(result.time[-1])

    def series(self, name: str) -> Any:
        """A scalar at every point kept, or the points themselves (`time`) [s]."""
        return self._result.time if name == "time" else self._result[name]

    def at(self, name: str, time: float, shape: tuple[int, int] | None = None) -> Any:
        """A scalar, or a map of `shape`, at the last point kept up to a time [s]."""
        point = np.searchsorted(self._result.time, time, side="right") - 1
        if shape is None:
            return float(self._result[name][point])
        cells = [[self._result[f"{name}[{i + 1},{j + 1}]"][point] for j in range(shape[1])] for i in range(shape[0])]
        return np.array(cells)


def reference_folder(model: str) -> Path:
    """Path of the reference results of a model, by its name after `InkLoop.`, as in the Modelica Standard Library."""
    return _REFERENCES / model.replace(".", "/")


def reference_file(model: str) -> Path:
    """The reference results of a model."""
    return reference_folder(model) / f"{model.rpartition('.')[2]}.csv"


def stop_time(model: str) -> float:
    """The stop time of a model [s]."""
    text = (LIBRARY / f"{model.replace('.', '/')}.mo").read_text()
    stop = re.search(r"experiment\(StopTime=([\d.]+), Tolerance=", text)
    assert stop is not None
    return float(stop[1])


def comparison_signals(model: str) -> list[str]:
    """The variables that tools are to compare, `time` first."""
    return (reference_folder(model) / "comparisonSignals.txt").read_text().split()


def rows_of(run: Simulation, signals: Sequence[str]) -> list[tuple[float, ...]]:
    """The signals at every point kept, in two rows where they jump: before and after an event at the same time."""
    times = run.series("time").round(9)  # an event lies apart from a point by the last bits
    rows = np.column_stack([times, *(run.series(name) for name in signals[1:])])
    last = np.flatnonzero(np.diff(times, append=np.inf))
    first = np.concatenate([[0], last[:-1] + 1])
    kept = np.stack([first, last], axis=1).ravel()
    jumps = np.concatenate([[True], (rows[kept[1:]] != rows[kept[:-1]]).any(axis=1)])
    return [tuple(row) for row in rows[kept[jumps]].tolist()]


_session = cache(rumoca.Session)
"""Session shared by all models: it reads the library once."""


@cache
def compiled(model: str) -> rumoca.Model:
    """A class of the library that is a whole model, by its name after `InkLoop.`; raises rumoca.CompileError."""
    return _session().load(str(LIBRARY / "package.mo"), model=f"InkLoop.{model}")


@cache
def simulate(model: str, stop: float) -> Simulation:
    """Run a model of the library up to a time [s]; raises rumoca.SimulationError at a failed assertion."""
    return Simulation(compiled(model).simulate(t=(0.0, stop), dt=0.5))


def simulate_text(text: str, stop: float) -> Simulation:
    """Run `model M` of a text that uses the library."""
    model = rumoca.Session(roots=[str(LIBRARY.parent)]).loads(f"within ;\n{text}", model="M")
    return Simulation(model.simulate(t=(0.0, stop), dt=0.5))


def literal(values: Any) -> str:
    """An array as a Modelica expression with every digit."""
    if isinstance(values, np.ndarray):
        return "{" + ", ".join(literal(part) for part in values) + "}"
    return repr(values.item())


class JModelica:
    """The compiler of an installed JModelica, by others, in the folder of `JMODELICA_HOME` (its own variable)."""

    _MAIN = "org.jmodelica.modelica.compiler.ModelicaCompiler"

    @property
    def _home(self) -> Path:
        return Path(os.environ["JMODELICA_HOME"])

    def reason_it_is_absent(self) -> str:
        """A sentence; "" where it is there."""
        if not os.environ.get("JMODELICA_HOME"):
            return "JMODELICA_HOME is not set: there is no JModelica, which no package registry has"
        if not (self._home / "lib" / "ModelicaCompiler.jar").is_file():
            return f"{self._home} has no lib/ModelicaCompiler.jar: JMODELICA_HOME is not the folder of a JModelica"
        if shutil.which("java") is None:
            return "java is not installed; Debian has it in default-jre-headless (make tools)"
        return ""

    def copy_of_library(self, folder: Path) -> Path:
        """The library as it reads it: its grammar is older than `pure function` (Modelica 3.3), the default."""
        copy = shutil.copytree(LIBRARY, folder / LIBRARY.name)
        for file in copy.rglob("*.mo"):
            file.write_text(re.sub(r"^pure function", "function", file.read_text(), flags=re.MULTILINE))
        return copy

    def compile(self, library: Path, model: str) -> list[str]:
        """Flatten, check and sort the equations, as before its code generation; errors and warnings, one line each.

        Raises ValueError with the errors.
        """
        jars = [*sorted((self._home / "lib").glob("*.jar")), self._home / "ThirdParty/Beaver/lib/beaver-rt.jar"]
        java = ["java", "-cp", os.pathsep.join(map(str, jars)), self._MAIN]
        options = ["-log=w", f"-modelicapath={library.parent}", "-target=nocodegen"]
        done = subprocess.run(
            [*java, *options, str(library), f"InkLoop.{model}"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        parts = re.split(r"^(?=Warning |Error )", done.stdout, flags=re.MULTILINE)
        messages = [" ".join(part.split()) for part in parts if part.strip()]
        if done.returncode or not all(message.startswith("Warning ") for message in messages):
            raise ValueError(f"InkLoop.{model}: {' '.join(messages)}")
        return [re.sub(r"^Warning at .*?, in file '.*?'[,:] (In component \w+: )?", "", each) for each in messages]


JMODELICA = JModelica()

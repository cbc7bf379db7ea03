"""FMUs of others by inkloop and by FMPy's `simulate_fmu`: a row of a table for each."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import fmpy
import numpy as np

from inkloop.errors import ComponentError, FmuError
from inkloop.fmu import FmuComponent, Variable

STEP_NS, STEPS = 125_000_000, 16
"""Times are sums without rounding: FMPy steps by the same."""


@dataclass(frozen=True)
class Row:
    """A row of the table: variables compared and their largest difference, relative to the largest value of each; or
    the reason why there is none.
    """

    name: str
    fmi: str
    variables: int = 0
    difference: float = 0.0
    reason: str = ""
    tool: str = ""

    @property
    def text(self) -> str:
        """A row of Markdown."""
        found = f"{self.variables} | {self.difference:.1e} |" if not self.reason else f"- | - | {self.reason}"
        return f"| {self.name} | {self.fmi} | {found} |"


def row_of(path: Path) -> Row:
    """The row of an FMU, from a process of its own, which native code may crash."""
    with ProcessPoolExecutor(1, get_context("spawn")) as process:
        try:
            return process.submit(compared, path).result()
        except BrokenProcessPool:
            return Row(path.stem, "-", reason="crashed")


def compared(path: Path) -> Row:
    """All outputs of an FMU after each step by inkloop, against those of `simulate_fmu`."""
    try:
        part = FmuComponent(path)
        model = fmpy.read_model_description(str(path), validate=False)
        inputs = {port.name: port.start_value() for port in part.inputs}
        rows = [part.initialize(0, inputs)]
        rows += [part.do_step(step * STEP_NS, STEP_NS, inputs) for step in range(STEPS)]
        part.terminate()
    except (FmuError, ComponentError) as error:
        return Row(path.stem, "-", reason=str(error).rpartition(f"{path.name}: ")[2])
    row = Row(path.stem, model.fmiVersion, tool=model.generationTool or "")
    try:
        theirs = fmpy.simulate_fmu(
            str(path),
            start_time=0.0,
            step_size=STEP_NS / 1e9,
            output_interval=STEP_NS / 1e9,
            stop_time=STEPS * STEP_NS / 1e9,
            fmi_type="CoSimulation",
            validate=False,
        )
    except Exception as error:  # FMPy raises of every kind
        return replace(row, reason=f"FMPy: {error}")
    if len(theirs) != len(rows):
        return replace(row, reason=f"FMPy: {len(theirs)} rows of {len(rows)}")
    differences = [
        difference(np.array([each[name] for each in rows]), column_of(theirs, name, variable))
        for name, variable in part.description.variables.items()
        if name in rows[0]
    ]
    return replace(row, variables=len(differences), difference=max(differences, default=0.0))


def column_of(theirs: Any, name: str, variable: Variable) -> Any:
    """A variable in the rows of FMPy, which has a column for each scalar of FMI 2."""
    if not variable.elements:
        return theirs[name]
    return np.column_stack([theirs[each] for each in variable.elements]).reshape(len(theirs), *variable.shape({}))


def difference(ours: Any, theirs: Any) -> float:
    """The largest difference of two series, relative to the largest value; infinite where one alone is no number."""
    if np.array_equal(ours, theirs, equal_nan=ours.dtype.kind == "f"):
        return 0.0
    apart, largest = np.abs(np.subtract(ours, theirs, dtype=float)), float(np.abs(np.asarray(theirs, float)).max())
    return float(apart.max() / largest) if largest > 0.0 and np.isfinite(apart).all() else float("inf")

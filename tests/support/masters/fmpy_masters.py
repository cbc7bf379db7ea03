"""The loop of a system of FMUs by FMPy: by its calls, and by its own runner of an .ssp."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv

from inkloop.exchange.ssp import ssd
from inkloop.exchange.ssp.system import Part, System
from support.masters.loops import TIME_MAX_S, Loop

GAUSS_SEIDEL = "Gauss-Seidel"


class _Instance:
    """One FMU by the calls of FMPy."""

    def __init__(self, part: Part) -> None:
        self._part, self._fmi2 = part, part.description.fmi == 2
        self._folder = fmpy.extract(str(part.file))
        description = fmpy.read_model_description(self._folder)
        self._fmu: Any = fmpy.instantiate_fmu(self._folder, description, fmi_type="CoSimulation")
        for name, value in part.values.items():
            self.set(name, value)
        if self._fmi2:
            self._fmu.setupExperiment()
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def set(self, name: str, value: Any) -> None:
        variable = self._part.variable(name)
        self._call("set", variable.type)(list(variable.references), np.ravel(value).tolist())

    def get(self, name: str) -> Any:
        variable = self._part.variable(name)
        count = int(np.prod(self._part.shape(name)))
        references = list(variable.references)
        get = self._call("get", variable.type)
        return np.array(get(references) if self._fmi2 else get(references, count))

    def step(self, time_s: float, step_s: float) -> None:
        self._fmu.doStep(currentCommunicationPoint=time_s, communicationStepSize=step_s)

    def free(self) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()
        shutil.rmtree(self._folder)

    def _call(self, verb: str, kind: str) -> Callable[..., Any]:
        kind = {"Enumeration": "Integer" if self._fmi2 else "Int64"}.get(kind, kind)
        call: Callable[..., Any] = getattr(self._fmu, verb + kind)
        return call


def by_calls(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """Jacobi: all inputs from the last communication point; Gauss-Seidel: each part on what the others gave last."""
    parts = {part.name: _Instance(part) for part in system.parts}
    try:
        for number in range(round(TIME_MAX_S / system.step_s)):
            for turn in [[name] for name in parts] if algorithm == GAUSS_SEIDEL else [list(parts)]:
                for wire in system.wires:
                    if wire.target[0] in turn:
                        parts[wire.target[0]].set(wire.target[1], parts[wire.source[0]].get(wire.source[1]))
                for name in turn:
                    parts[name].step(number * system.step_s, system.step_s)
            shown = parts[loop.part]
            yield int(shown.get("layers_printed")[0]), np.concatenate([shown.get(port) for port in loop.ports])
    finally:
        for part in parts.values():
            part.free()


def by_simulate_ssp(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[tuple[int, Any]]:
    """FMPy's own runner of an .ssp; rows hold what the outputs are after the step."""
    path = folder / "block.ssp"
    ssd.write(system, "1.0", path)
    values = _parameters(path, folder)
    rows = simulate_ssp(str(path), stop_time=TIME_MAX_S, step_size=system.step_s, parameter_set=values)
    for row in rows:
        numbers = [row[f"{loop.part}.{name}"] for name in loop.scalars(system)]
        yield int(row[f"{loop.part}.layers_printed"]), np.array(numbers)


def _parameters(path: Path, folder: Path) -> Any:
    """The parameters of an .ssp, as FMPy wants them."""
    shutil.unpack_archive(path, folder / "ssp", "zip")
    values: Any = read_ssv(str(folder / "ssp" / "resources" / "parameters.ssv"))
    for parameter in values.parameters:  # FMPy takes the text "false" for true
        parameter.value = {"true": 1.0, "false": 0.0}.get(parameter.value, parameter.value)
    return values

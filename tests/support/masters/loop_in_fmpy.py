"""The closed loop of shipped FMI 2 FMUs, 9 x 9 cells, with FMPy as the master: a program for any environment.

Prints the status and the layers at the end, and the lowest and the highest cell of the part [m]; it is to be 20 um.
"""

from __future__ import annotations

import shutil
from typing import Any

import fmpy
from fmpy.fmi2 import FMU2Slave

from inkloop import find_fmu

MODELS = ("LayerController", "LayerDeposition", "ProfileSensor")
PART = [f"[{i},{j}]" for i in range(3, 8) for j in range(3, 8)]
TARGET = 20e-6
KINDS = {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean"}
DONE = 2


class Model:
    """An FMU that runs, and its variables by name."""

    def __init__(self, model: str) -> None:
        path = str(find_fmu(model, "fmi2"))
        self.description = fmpy.read_model_description(path)
        self.folder = fmpy.extract(path)
        identifier = self.description.coSimulation.modelIdentifier
        self._fmu = FMU2Slave(
            guid=self.description.guid, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=model
        )
        self._fmu.instantiate()
        self._fmu.setupExperiment(startTime=0.0)
        self._variables = {variable.name: variable for variable in self.description.modelVariables}

    def names(self, causality: str) -> list[str]:
        return [name for name, variable in self._variables.items() if variable.causality == causality]

    def set(self, values: dict[str, Any]) -> None:
        for kind, names in self._by_kind(values).items():
            references = [self._variables[name].valueReference for name in names]
            getattr(self._fmu, f"set{kind}")(references, [values[name] for name in names])

    def get(self, names: list[str]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for kind, own in self._by_kind(names).items():
            references = [self._variables[name].valueReference for name in own]
            found |= dict(zip(own, getattr(self._fmu, f"get{kind}")(references), strict=True))
        return found

    def _by_kind(self, names: Any) -> dict[str, list[str]]:
        kinds: dict[str, list[str]] = {}
        for name in names:
            kinds.setdefault(KINDS[self._variables[name].type], []).append(name)
        return kinds

    def begin(self) -> None:
        self._fmu.enterInitializationMode()
        self._fmu.exitInitializationMode()

    def step(self, time: float) -> None:
        self._fmu.doStep(currentCommunicationPoint=time, communicationStepSize=1.0)

    def end(self) -> None:
        self._fmu.terminate()
        self._fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


def main() -> None:
    """Print a plate of 5 x 5 cells."""
    controller, deposition, sensor = loop = [Model(name) for name in MODELS]
    controller.set({f"target_height{cell}": TARGET for cell in PART} | {f"mask{cell}": True for cell in PART})
    deposition.set({"layer_duration": 0.0})
    sensor.set({"scan_duration": 0.0})
    for model in loop:
        model.begin()
    signals: dict[str, Any] = {}
    time, status = 0.0, 0
    while status != DONE and time < 100.0:
        for model in loop:
            model.set({name: signals[name] for name in model.names("input") if name in signals})
            model.step(time)
            signals |= model.get(model.names("output"))
            status = signals["status"] if model is controller else status
        time += 1.0
    heights = {name.removeprefix("height"): value for name, value in signals.items() if name.startswith("height[")}
    part = [heights[cell] for cell in PART]
    print(status, signals["layers_printed"], min(part), max(part))
    for model in loop:
        model.end()


if __name__ == "__main__":
    main()

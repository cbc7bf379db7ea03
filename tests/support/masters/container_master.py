"""The loop as one FMU that steps three: fmucontainer of the FMU Manipulation Toolbox, driven by FMPy."""

from __future__ import annotations

import logging
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmu_manipulation_toolbox.assembly import Assembly, AssemblyNode

from inkloop.exchange.ssp import ssd
from inkloop.exchange.ssp.system import Part, System
from support.masters.loops import TIME_MAX_S, Loop


def by_container(
    loop: Loop, system: System, algorithm: str, folder: Path, *, reads_parameters: bool = True
) -> Iterator[tuple[int, Any]]:
    """An .ssp compiled into one FMU that steps its three, driven by FMPy: its outputs are those that the loop shows.

    fmucontainer 2.0 skips the parameter sets of an .ssp: they are given beside, unless `reads_parameters` is False.
    """
    fmi = system.parts[0].description.fmi
    flags = {  # fmucontainer 2.0 cannot write start values of an array of Booleans: they come from outside
        (part.name, name): np.ravel(value).tolist()
        for part in system.parts
        for name, value in part.values.items()
        if fmi == 3 and value.size > 1 and part.variable(name).type == "Boolean"
    }
    version = "1.0" if fmi == 2 else "2.0"
    ssd.write(system, version, folder / "loop.ssp")
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.ERROR)  # else a line for each open output
    assembly = Assembly("loop.ssp", fmu_directory=folder, default_step_size=system.step_s)
    node, file = assembly.root, "loop.dir/{}.fmu".format
    node.sequential = algorithm == "Gauss-Seidel"
    for part in system.parts if reads_parameters else ():
        for name, value in part.values.items():
            for scalar, text in _start_values(part, name, value) if (part.name, name) not in flags else ():
                node.add_start_value(file(part.name), scalar, text)
    for part_name, name in flags:
        node.add_input(name, file(part_name), name)
    for name in [*loop.scalars(system), "layers_printed"]:
        node.add_output(file(loop.part), name, name)
    assembly.make_fmu(fmi_version=fmi)
    values = {name: flags[part, name] for part, name in flags}
    shapes = [system.part(loop.part).shape(port) for port in loop.ports]
    shown = _Shown(loop.scalars(system), sum(int(np.prod(shape)) for shape in shapes))
    yield from _steps_of_one(folder / "loop.fmu", system.step_s, values, shown)


def exchanged_by_container(file: Path, folder: Path, steps: int) -> dict[str, tuple[int, int]]:
    """Frames sent and received by "one" and "other", two copies of a bench (FMI-LS-BUS) after so many steps of 1 ms.

    fmucontainer 2.0 finds no terminal below a GraphicalRepresentation, which the schema puts first: their members are
    linked instead.
    """
    names, counts = ("one", "other"), ("frames_sent", "frames_received")
    node = AssemblyNode("two.fmu", step_size=0.001, auto_output=False)
    for name in names:
        shutil.copy(file, folder / f"{name}.fmu")
        node.add_fmu(f"{name}.fmu")
        for count in counts:
            node.add_output(f"{name}.fmu", count, f"{name}_{count}")
    for sender, taker in (names, names[::-1]):
        for member in ("Data", "Clock"):
            node.add_link(f"{sender}.fmu", f"Tx_{member}", f"{taker}.fmu", f"Rx_{member}")
    node.make_fmu(folder, fmi_version=3)
    asked = [f"{name}_{count}" for name in names for count in counts]
    end = fmpy.simulate_fmu(str(folder / "two.fmu"), stop_time=steps / 1000, step_size=0.001, output=asked)[-1]
    return {name: (int(end[f"{name}_{counts[0]}"]), int(end[f"{name}_{counts[1]}"])) for name in names}


def _start_values(part: Part, name: str, value: Any) -> Iterator[tuple[str, str]]:
    """A text for each scalar; all elements in one, with blanks between, where FMI 3 has an array."""
    texts = [str(number).lower() for number in np.ravel(value).tolist()]
    scalars = part.scalars(name)
    yield from zip(scalars, texts if len(scalars) > 1 else [" ".join(texts)], strict=True)


@dataclass(frozen=True)
class _Shown:
    """Outputs of the container, and how many numbers they are in FMI 3."""

    names: Sequence[str]
    numbers: int


def _steps_of_one(
    file: Path, step_s: float, flags: Mapping[str, list[bool]], shown: _Shown
) -> Iterator[tuple[int, Any]]:
    """(layers_printed, numbers) after each step; its arrays of FMI 2 are called as before."""
    folder = fmpy.extract(str(file))
    description = fmpy.read_model_description(folder, validate=False)  # attributes of its own in FMI 2
    fmu: Any = fmpy.instantiate_fmu(folder, description, fmi_type="CoSimulation")
    references = {v.name: v.valueReference for v in description.modelVariables}
    asked, printed = [references[name] for name in shown.names], references["layers_printed"]
    for name, values in flags.items():
        fmu.setBoolean([references[name]], values)
    if is_fmi2 := description.fmiVersion == "2.0":
        fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    try:
        for number in range(round(TIME_MAX_S / step_s)):
            fmu.doStep(currentCommunicationPoint=number * step_s, communicationStepSize=step_s)
            numbers = fmu.getReal(asked) if is_fmi2 else fmu.getFloat64(asked, shown.numbers)
            (count,) = fmu.getInteger([printed]) if is_fmi2 else fmu.getInt32([printed])
            yield int(count), np.array(numbers)
    finally:
        fmu.freeInstance()
        shutil.rmtree(folder)

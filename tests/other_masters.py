"""The whole loop of a scenario in masters of other people: each drives the same FMUs its own way.

A master here is a function of a system of FMUs, the step and the algorithm that yields (layers_printed, height) after
each communication step, height (nx, ny) [m]. What it starts from is what `inkloop export-ssp` writes where the master
reads such files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from fmpy_masters import GAUSS_SEIDEL, by_calls, by_simulate_ssp
from inkloop.ssp import osp
from inkloop.ssp.system import System, system_of
from java_programs import MAESTRO
from maestro_master import by_maestro
from other_programs import ECOS, FMPY, FMUTOOL, LIBCOSIM, Program
from six_by_six import LAYERS, SHAPE, TIME_MAX_S, scenario_in

Step = tuple[int, Any]
JACOBI = "Jacobi"


@dataclass(frozen=True)
class Master:
    """Somebody's master: the versions of FMI and the algorithms that it runs the loop by."""

    name: str
    program: Program
    starts_from: str
    forms: tuple[tuple[str, str], ...]
    run: Callable[[System, str, Path], Iterator[Step]]


def layers_by(master: Master, fmi: str, algorithm: str, step_s: float, folder: Path) -> Any:
    """The surfaces that a master prints, (layers, nx, ny) [m]; fewer where it does not get that far in time."""
    system = replace(system_of(scenario_in(folder), fmi, folder), step_s=step_s)
    found: dict[int, Any] = {0: None}
    for printed, height in islice(master.run(system, algorithm, folder), round(TIME_MAX_S / step_s)):
        found.setdefault(printed, height)
        if printed >= LAYERS:
            break
    return np.array([height for printed, height in sorted(found.items()) if 0 < printed <= LAYERS])


def _container(system: System, algorithm: str, folder: Path) -> Iterator[Step]:
    from container_master import by_container

    return by_container(system, algorithm, folder)


def _libcosim(system: System, algorithm: str, folder: Path) -> Iterator[Step]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    (folder / osp.FILE).write_bytes(osp.structure(system))
    execution = CosimExecution.from_osp_config_file(osp_path=str(folder))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    printer = execution.slave_index_from_instance_name("printer")
    variables = system.part("printer").description.variables
    while True:
        assert execution.step()
        (printed,) = observer.last_integer_values(printer, list(variables["layers_printed"].references))
        height = observer.last_real_values(printer, list(variables["height"].references))
        yield int(printed), np.reshape(height, SHAPE)


def _ecos(system: System, algorithm: str, folder: Path) -> Iterator[Step]:
    """Wired call by call: what an .ssp says of the parameters of a whole system, Ecos leaves out."""
    from ecospy import EcosLib, EcosSimulation, EcosSimulationStructure

    EcosLib.set_log_level("off")
    structure = EcosSimulationStructure()
    for part in system.parts:
        structure.add_model(part.name, str(part.file))
    connect = {
        "Real": structure.make_real_connection,
        "Integer": structure.make_int_connection,
        "Boolean": structure.make_bool_connection,
    }
    for wire in system.wires:
        kind = system.part(wire.source[0]).variable(wire.source[1]).type
        for source, target in system.pairs(wire):
            connect[kind](f"{wire.source[0]}::{source}", f"{wire.target[0]}::{target}")
    values = {
        f"{part.name}::{scalar}": number
        for part in system.parts
        for name, value in part.values.items()
        for scalar, number in zip(part.scalars(name), np.ravel(value).tolist(), strict=True)
    }
    structure.add_parameter_set("of the scenario", values)
    names = system.part("printer").scalars("height")
    with EcosSimulation(step_size=system.step_s, structure=structure) as simulation:
        simulation.init(parameter_set="of the scenario")
        for _ in range(round(TIME_MAX_S / system.step_s)):
            simulation.step()
            height = [simulation.get_real(f"printer::{name}") for name in names]
            yield int(simulation.get_integer("printer::layers_printed")), np.reshape(height, SHAPE)


BOTH = tuple((fmi, algorithm) for fmi in ("2", "3") for algorithm in (JACOBI, GAUSS_SEIDEL))
MASTERS = (
    Master("FMPy, a loop of its calls", FMPY, "the FMUs", BOTH, by_calls),
    Master("FMPy, `simulate_ssp`", FMPY, "an .ssp", (("2", JACOBI),), by_simulate_ssp),
    Master("fmucontainer", FMUTOOL, "its JSON", BOTH, _container),
    Master("libcosim", LIBCOSIM, "OspSystemStructure.xml", (("2", JACOBI),), _libcosim),
    Master("Ecos", ECOS, "its Python calls", (("2", JACOBI),), _ecos),
    Master("Maestro", MAESTRO, "its two JSON files", (("2", JACOBI),), by_maestro),
)

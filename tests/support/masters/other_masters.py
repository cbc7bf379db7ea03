"""The whole loop of a scenario in masters of other people: each drives the same FMUs its own way.

A master here is a function of a loop, its system of FMUs and the algorithm that yields (layers_printed, numbers) after
each communication step, numbers being those that the ports of the loop show, in SI. What it starts from is what
`inkloop export ssp` writes where the master reads such files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.exchange.ssp import folder as files
from inkloop.exchange.ssp.system import System
from support.masters.cofmupy_master import COFMUPY, by_cofmupy
from support.masters.container_master import by_container
from support.masters.file_masters import by_maestro, by_omsimulator
from support.masters.fmpy_masters import GAUSS_SEIDEL, by_calls, by_simulate_ssp
from support.masters.java_programs import MAESTRO
from support.masters.loops import LAYERS, THREE_FMUS, TIME_MAX_S, Loop, scenario_in
from support.masters.other_programs import ECOS, FMPY, FMUTOOL, LIBCOSIM, OMSIMULATOR, Program

Step = tuple[int, Any]
JACOBI = "Jacobi"


@dataclass(frozen=True)
class Master:
    """A master of others: the versions of FMI and the algorithms that it runs the loop by."""

    name: str
    program: Program
    forms: tuple[tuple[str, str], ...]
    block_forms: tuple[str, ...]
    run: Callable[[Loop, System, str, Path], Iterator[Step]]

    def forms_of(self, loop: Loop) -> tuple[tuple[str, str], ...]:
        """(FMI, algorithm); a single block needs none."""
        return self.forms if loop is THREE_FMUS else tuple((fmi, "-") for fmi in self.block_forms)


def layers_by(master: Master, loop: Loop, fmi: str, algorithm: str, step_s: float, folder: Path) -> Any:
    """Output of a master, (layers, numbers); fewer layers if it does not get that far in time."""
    system = replace(loop.system_of(scenario_in(folder), fmi, folder), step_s=step_s)
    found: dict[int, Any] = {0: None}
    for printed, numbers in islice(master.run(loop, system, algorithm, folder), round(TIME_MAX_S / step_s)):
        found.setdefault(printed, numbers)
        if printed >= LAYERS:
            break
    return np.array([numbers for printed, numbers in sorted(found.items()) if 0 < printed <= LAYERS])


def _libcosim(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[Step]:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    (folder / files.OSP_FILE).write_bytes(files.osp_structure(system))
    execution = CosimExecution.from_osp_config_file(osp_path=str(folder))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    slave = execution.slave_index_from_instance_name(loop.part)
    variables = system.part(loop.part).description.variables
    while True:
        assert execution.step()
        (printed,) = observer.last_integer_values(slave, list(variables["layers_printed"].references))
        numbers = observer.last_real_values(slave, [r for port in loop.ports for r in variables[port].references])
        yield int(printed), np.array(numbers)


def _ecos(loop: Loop, system: System, algorithm: str, folder: Path) -> Iterator[Step]:
    """Wired call by call: Ecos ignores the parameters that an .ssp sets for a whole system."""
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
    with EcosSimulation(step_size=system.step_s, structure=structure) as simulation:
        simulation.init(parameter_set="of the scenario")
        for _ in range(round(TIME_MAX_S / system.step_s)):
            simulation.step()
            numbers = [simulation.get_real(f"{loop.part}::{name}") for name in loop.scalars(system)]
            yield int(simulation.get_integer(f"{loop.part}::layers_printed")), np.array(numbers)


BOTH = tuple((fmi, algorithm) for fmi in ("2", "3") for algorithm in (JACOBI, GAUSS_SEIDEL))
FMUCONTAINER = Master("fmucontainer", FMUTOOL, BOTH, ("2", "3"), by_container)
MASTERS = (
    Master("FMPy, a loop of its calls", FMPY, BOTH, ("2", "3"), by_calls),
    Master("FMPy, `simulate_ssp`", FMPY, (("2", JACOBI),), ("2",), by_simulate_ssp),
    FMUCONTAINER,
    Master("libcosim", LIBCOSIM, (("2", JACOBI),), ("2",), _libcosim),
    Master("Ecos", ECOS, (("2", JACOBI),), ("2", "3"), _ecos),
    Master("Maestro", MAESTRO, (("2", JACOBI),), ("2",), by_maestro),
    Master("OMSimulator", OMSIMULATOR, (("2", JACOBI),), ("2",), by_omsimulator),
    Master("cofmupy", COFMUPY, (("2", JACOBI), ("3", JACOBI)), ("2", "3"), by_cofmupy),
)

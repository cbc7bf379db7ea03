"""Overhead of the master per communication step: against other masters on one FMU, and on large grids."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from time import process_time

import fmpy
import numpy as np
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
from rich.console import Group
from rich.table import Table

from benchmarks.timing import scaled, table_of
from inkloop.component import Component, Job, Port, Values
from inkloop.course.layer_course import contract_connections
from inkloop.fmu import FmuComponent
from inkloop.fmu_writer.export import export_fmu
from inkloop.master.master import Master
from inkloop.results.recorder import Recorder
from inkloop.units import NS_PER_S

STEPS = 2000
SIDE = 20
SIDES = (20, 200, 1000)


def measure() -> Group:
    """Time per communication step against other masters, and the master's own share on grids up to 10^6 cells."""
    return Group(_against_others(), _own_share())


def _against_others() -> Table:
    """A LayerDeposition that commands itself, one layer every tenth step, all outputs read in every step.

    Of ours and libcosim's the steps alone, of FMPy's what `simulate_fmu` takes.
    """
    table = table_of(
        f"communication step, LayerDeposition {SIDE} x {SIDE}, {STEPS} steps, processor time",
        ("FMU", "inkloop", "of it the master, wall", "FMPy", "FMPy / inkloop", "libcosim", "libcosim / inkloop"),
    )
    log_output_level(CosimLogLevel.ERROR)
    with tempfile.TemporaryDirectory() as folder:
        for fmi in ("3", "2"):
            path = export_fmu("LayerDeposition", fmi=fmi, nx=SIDE, ny=SIDE, out=Path(folder) / f"{fmi}.fmu")
            ours, own = min(_inkloop(path) for _ in range(3))
            fmpy_s = min(_fmpy(path) for _ in range(3))
            row = [f"FMI {fmi}", scaled(ours), scaled(own), scaled(fmpy_s), f"{fmpy_s / ours:.2f}"]
            if fmi == "2":
                cosim_s = min(_libcosim(path) for _ in range(3))
                row += [scaled(cosim_s), f"{cosim_s / ours:.2f}"]
            table.add_row(*row)
    return table


def _own_share() -> Table:
    """Three components that cost nothing hand maps round; what remains is the master's and the recorder's."""
    table = table_of(
        "the loop without its components: controller, printer and profiler hand over ready maps",
        ("grid", "master per step", "per cell", "recorder per layer", "per cell"),
    )
    for side in SIDES:
        master_s, recorder_s = _ready_maps(side)
        cells = side * side
        row = (scaled(master_s), scaled(master_s / cells), scaled(recorder_s), scaled(recorder_s / cells))
        table.add_row(f"{side} x {side}", *row)
    return table


def _inkloop(path: Path) -> tuple[float, float]:
    """Seconds per step of our master with the FMU alone, and the master's own share."""
    printer = FmuComponent(path, parameters={"layer_period": 10.0}, structural={"nx": SIDE, "ny": SIDE})
    components: dict[str, Component] = {"printer": printer, "held": _Ready(printer.inputs)}
    clock = _Clock()
    master = Master(components, contract_connections(components), step_ns=NS_PER_S, observers=[clock])
    master.run(time_max_ns=STEPS * NS_PER_S)
    return (clock.end - clock.begin) / STEPS, master.wall_s["master"] / STEPS


def _fmpy(path: Path) -> float:
    description = fmpy.read_model_description(str(path), validate=False)
    folder = fmpy.extract(str(path))
    begin = process_time()
    result = fmpy.simulate_fmu(
        folder,
        model_description=description,
        validate=False,
        start_values={"layer_period": 10.0},
        stop_time=float(STEPS),
        output_interval=1.0,
        use_event_mode=False,
    )
    elapsed = process_time() - begin
    assert result["layers_printed"][-1] == STEPS // 10
    return elapsed / STEPS


def _libcosim(path: Path) -> float:
    execution = CosimExecution.from_step_size(NS_PER_S)
    slave = execution.add_local_slave(CosimLocalSlave(fmu_path=str(path), instance_name="printer"))
    references = {variable.name.decode(): variable.reference for variable in execution.slave_variables(slave)}
    execution.real_initial_value(slave, references["layer_period"], 10.0)
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.step(step_count=1)  # initializes
    begin = process_time()
    execution.step(step_count=STEPS)
    elapsed = process_time() - begin
    assert observer.last_integer_values(slave, [references["layers_printed"]]) == [STEPS // 10]
    return elapsed / STEPS


def _ready_maps(side: int) -> tuple[float, float]:
    """Seconds of the master per step, and of the recorder per layer, for a layer in every step."""
    steps = max(5, min(500, 2_000_000 // side**2))
    grid = (side, side)
    height, pattern = Port("height", "m", grid), Port("pattern", shape=grid, dtype="int32")
    measured, valid = Port("measured_height", "m", grid), Port("valid", shape=grid, dtype="bool")
    command, printed, scanned = (
        Port(name, dtype="int32") for name in ("layer_command", "layers_printed", "layers_scanned")
    )
    components = {
        "controller": _Ready((pattern, command), (measured, valid, scanned, printed), counts="layer_command"),
        "printer": _Ready((height, printed), (pattern, command), counts="layers_printed"),
        "profiler": _Ready((measured, valid, scanned), (height, printed), counts="layers_scanned"),
    }
    job = Job(side, side, 1e-4, np.zeros(grid), np.ones(grid, dtype=np.bool_))
    recorder = Recorder(job, components)
    master = Master(components, contract_connections(components), step_ns=NS_PER_S, observers=[recorder])
    master.run(time_max_ns=steps * NS_PER_S)
    return master.wall_s["master"] / steps, master.wall_s["observers"] / steps


class _Clock:
    """An observer that sees the processor time of the steps alone [s]."""

    begin = end = 0.0

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.begin = process_time()

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.end = process_time()


class _Ready:
    """A component whose outputs are ready before it is asked; `counts` names the one that rises with every step."""

    def __init__(self, outputs: tuple[Port, ...], inputs: tuple[Port, ...] = (), counts: str = "") -> None:
        self.inputs, self.outputs, self._counts = inputs, outputs, counts
        self._values: Values = {port.name: port.start_value() for port in outputs}
        for value in self._values.values():
            value.flags.writeable = False

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._values

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        if self._counts:
            self._values = {**self._values, self._counts: self._values[self._counts] + np.int32(1)}
        return self._values

    def terminate(self) -> None:
        """Nothing to release."""

"""What the master adds to a communication step, beside FMPy's `simulate_fmu` on the same FMU."""

from __future__ import annotations

from collections.abc import Mapping
from time import perf_counter

import fmpy
from rich.table import Table

from benchmarks.timing import scaled
from inkloop.component import Port, Values
from inkloop.export import find_fmu
from inkloop.fmu import FmuComponent
from inkloop.master import Master
from inkloop.wiring import contract_connections

STEPS = 2000
FORMS = ("fmi3", "fmi2")


def measure() -> Table:
    """Time per communication step of a self-commanding LayerDeposition, one layer every tenth step."""
    table = Table(title=f"communication step, LayerDeposition 9 x 9, {STEPS} steps, all outputs recorded")
    for heading in ("FMU", "FMPy simulate_fmu", "inkloop master", "FMPy / inkloop", "of it the master itself"):
        table.add_column(heading, justify="right")
    for form in FORMS:
        peer = min(_simulate_fmu(form) for _ in range(3))
        ours, own = min(_master(form) for _ in range(3))
        table.add_row(form, scaled(peer), scaled(ours), f"{peer / ours:.2f}", scaled(own))
    return table


def _simulate_fmu(form: str) -> float:
    path = str(find_fmu("LayerDeposition", form))
    description = fmpy.read_model_description(path, validate=False)
    folder = fmpy.extract(path)
    begin = perf_counter()
    result = fmpy.simulate_fmu(
        folder,
        model_description=description,
        validate=False,
        start_values={"layer_period": 10.0},
        stop_time=float(STEPS),
        output_interval=1.0,
        use_event_mode=False,
    )
    elapsed = perf_counter() - begin
    assert result["layers_printed"][-1] == STEPS // 10
    return elapsed / STEPS


def _master(form: str) -> tuple[float, float]:
    printer = FmuComponent(find_fmu("LayerDeposition", form), parameters={"layer_period": 10.0})
    observer = _EveryPoint()
    components = {"printer": printer, "held": _Held(printer)}
    wires = contract_connections(components)
    master = Master(components, wires, step_ns=1_000_000_000, observers=[observer])
    begin = perf_counter()
    master.run(time_max_ns=STEPS * 1_000_000_000)
    elapsed = perf_counter() - begin
    assert observer.layers[-1] == STEPS // 10
    return elapsed / STEPS, master.wall_s["master"] / STEPS


class _Held:
    """Holds the printer's inputs at their start values: the printer commands itself."""

    inputs: tuple[Port, ...] = ()

    def __init__(self, printer: FmuComponent) -> None:
        self.outputs = printer.inputs
        self._values = {port.name: port.start_value() for port in printer.inputs}

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return self._values

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        return self._values

    def terminate(self) -> None:
        """Nothing to release."""


class _EveryPoint:
    """Keeps every output of every communication point, as FMPy's recorder does."""

    def __init__(self) -> None:
        self.points: list[Mapping[str, Values]] = []

    @property
    def layers(self) -> list[int]:
        return [int(point["printer"]["layers_printed"]) for point in self.points]

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.points.append(dict(outputs))

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.points.append(dict(outputs))

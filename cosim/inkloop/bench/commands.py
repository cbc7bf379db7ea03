"""`inkloop bench`: the emulator in place of the nodes of a scenario, and actions of a person on the nodes."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from inkloop.component import FloatMap, Job
from inkloop.components import devices
from inkloop.components.catalog import MAPPED
from inkloop.components.fmu_parameters import parse_model
from inkloop.components.kind import Bench, load
from inkloop.errors import InkloopError, ScenarioError
from inkloop.fmu_writer.archive import read_definition
from inkloop.printing.on_devices import check_listening, live_words, local_port
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop.tables.bench_faults import FaultTable, read_fault
from inkloop.units import MS_PER_S

NO_CHANNEL = (
    "bench.interface and bench.channel are not set, and the emulator needs to know where to listen; add to the "
    'scenario\n    [bench]\n    interface = "slcan"\n    channel = "socket://127.0.0.1:28550"\nor use --port N or --pty'
)


def emulate(scenario: Scenario | None, options: argparse.Namespace, console: Terminal) -> int:
    """Run the emulator until Ctrl-C. Raises BusError where it cannot run, ScenarioError."""
    file = scenario.source if scenario else "SCENARIO"
    emulation = emulation_of(scenario) if scenario else Emulation()
    channel = scenario.tables.bench.channel if scenario else None
    port = options.port if options.port is not None else local_port(channel)
    if scenario and port is None and not options.pty:
        raise InkloopError(f"{file}: {NO_CHANNEL}" if channel is None else _other_channel(file, channel))
    faults = (*emulation.faults, *map(read_fault, options.fault))
    start = importlib.import_module("inkloop_hardware.emulated_bench").EmulatedBench
    running: Any = start(
        emulation.parameters,
        port=port or 0,
        terminal=options.pty,
        folder=options.folder,
        surface=emulation.surface,
        faults=[str(fault) for fault in faults],
    )
    with running:
        show = console.sentence
        show(f"emulator on {running.channel}: print head, stage, cure lamp and profiler")
        if scenario:
            grid = scenario.tables.grid
            show(f"{grid.nx} x {grid.ny} cells, ink and sensor from {file}")
        for fault in faults:
            show(f"injected fault: {fault}")
        hint = (
            "" if running.channel == channel else f" --set bench.interface=slcan --set bench.channel={running.channel}"
        )
        show(f"in another terminal: inkloop run {file}{hint}")
        kept = (
            f"journals and surface are kept in {options.folder}" if options.folder else "the next start is a new part"
        )
        show(f"Ctrl-C ends it; {kept}")
        console.result(channel=running.channel)
        try:
            code = int(running.wait())
        except KeyboardInterrupt:
            return 0
    raise InkloopError(f"the emulator on {running.channel} ended unexpectedly with exit code {code}")


def act(scenario: Scenario, action: str, console: Terminal, *, give_up: bool = False) -> int:
    """One action of a person on the bench of a scenario. Raises HardwareError.

    give_up: `clear` abandons the open layer.
    """
    bench = Bench(scenario.tables.bench.found_from(Path(scenario.source).parent))
    check_listening(scenario)
    mapped = [name for name, table in scenario.tables.components.items() if table.kind == MAPPED]
    with live_words(console, None):
        lines = _of_mapped(scenario, action, mapped, bench) if mapped else _of_nodes(scenario, action, bench, give_up)
        _show(lines, console)
    return 0


def mapping_of(scenario: Scenario, name: str) -> Any:
    """The mapping of a component of a valid scenario."""
    return load("inkloop_hardware.mapped.mapping_file", "load")(Path(scenario.options(name)["mapping"]), scenario.job())


def _of_mapped(scenario: Scenario, action: str, names: Iterable[str], bench: Bench) -> Iterator[Any]:
    """Lines of an action on mapped rigs. Raises InkloopError for one that they do not have."""
    actions = {
        "status": ("inkloop_hardware.doctor.status", "rig_status"),
        "stop": ("inkloop_hardware.mapped.mapped_layer", "stop_rig"),
    }
    if action not in actions:
        raise InkloopError(
            f"{scenario.source}: {action} is for inkloop's own nodes; this rig goes by its mapping: `status` shows the "
            "frames that it waits for, `stop` makes its [[stop]] steps"
        )
    act_on = load(*actions[action])
    for name in names:
        yield from act_on(bench.rig.settings, mapping_of(scenario, name))


def _of_nodes(scenario: Scenario, action: str, bench: Bench, give_up: bool) -> Iterator[Any]:
    """Lines of an action on the nodes."""
    if action in ("stop", "release"):
        stop = importlib.import_module("inkloop_hardware.devices.commands")
        send = stop.request_stop if action == "stop" else stop.release_stop
        yield from send(bench.rig.settings)
        return
    if action == "status":
        yield from load("inkloop_hardware.doctor.status", "status")(bench.rig)
        return
    commands = importlib.import_module("inkloop_hardware.devices.commands")
    with bench.rig as rig:
        if action == "clear":
            yield from commands.clear_all(rig, give_up=give_up)
        elif action == "dry-run":
            yield from commands.dry_run(rig, job_of_printer(scenario), cure_ms=scenario.tables.bench.cure_ms)
        else:
            yield from getattr(commands, action)(rig)


def job_of_printer(scenario: Scenario) -> Job:
    """The job as the printer of a scenario gets it."""
    printers = (
        devices.job_with_overrides(scenario.job(name), table.options)
        for name, table in scenario.tables.components.items()
        if table.kind == "hardware.printer"
    )
    return next(printers, scenario.job())


def _show(found: Iterable[Any], console: Terminal) -> None:
    """Show each line as it comes; as JSON also the fields of records."""
    shown = []
    for each in found:
        console.sentence(str(each))
        shown.append(each)
    nodes = [asdict(each) for each in shown if not isinstance(each, str)]
    console.result(lines=[str(each) for each in shown], **({"nodes": nodes} if nodes else {}))


def _other_channel(file: str, channel: str | int) -> str:
    return (
        f"{file}: bench.channel is {channel!r}, where devices are; the emulator listens on this machine: give "
        f"--port N or --pty, and give the run the channel that it then prints"
    )


NODE_CELLS_MAX = 1_000_000
"""Cells that a node of the bench holds (PATTERN_CELLS_MAX of the firmware)."""
_SEEDS = {"LayerDeposition": "printer_seed", "ProfileSensor": "sensor_seed"}
"""Models that the emulator stands for, and its names of their seeds. Its other parameters have the same names: those
that variables.toml calls emulated."""
_SAID_OTHERWISE = {"pitch", "passes", "pass_order", "pass_rotation", "layer_duration", "scan_duration", "height_start"}
"""Parameters set for the nodes by the master, by files, or by the times of the nodes."""


@dataclass(frozen=True, eq=False)
class Emulation:
    """Options of the emulator in SI, the surface to print on (nx, ny) [m], flat if None, and its faults."""

    parameters: dict[str, float] = field(default_factory=dict)
    surface: FloatMap | None = None
    faults: tuple[FaultTable, ...] = ()


def emulation_of(scenario: Scenario) -> Emulation:
    """The bench that stands for printer and profiler of a scenario, devices or our FMUs.

    Raises ScenarioError with every option that only the FMUs have.
    """
    grid = scenario.tables.grid
    parameters: dict[str, float] = {"nx": grid.nx, "ny": grid.ny}
    parameters |= dict.fromkeys(("alive_ms", "watchdog_ms"), round(scenario.tables.bench.silence_s * MS_PER_S))
    errors: list[str] = []
    if grid.nx * grid.ny > NODE_CELLS_MAX:
        errors.append(
            f"grid of {grid.nx} x {grid.ny} cells: the nodes of the bench hold up to {NODE_CELLS_MAX:,} cells; "
            "choose a smaller grid or a larger pitch"
        )
    for name, table in scenario.tables.components.items():
        model = devices.KINDS[table.kind].model if table.kind in devices.KINDS else table.kind
        if model not in _SEEDS:
            continue
        parsed = parse_model(model, scenario.job(name), table.options)
        values = parsed.values
        emulated = {variable.name for variable in read_definition(parsed.description.path).emulated}
        errors += [f"components.{name}.{error}" for error in _unknown(emulated, values)]
        parameters |= {key: value.item() for key, value in values.items() if key in emulated}
        parameters[_SEEDS[model]] = values["seed"].item()
    if errors:
        raise ScenarioError(scenario.source, errors)
    return Emulation(parameters, scenario.job().height_start, tuple(scenario.tables.bench.faults))


def _unknown(emulated: Set[str], values: Mapping[str, Any]) -> list[str]:
    known = {*emulated, *_SAID_OTHERWISE, "seed", "nx", "ny"}
    return [f"{name} is not emulated on a bench; leave it out" for name in values if name not in known]

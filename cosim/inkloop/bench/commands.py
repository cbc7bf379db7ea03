"""`inkloop bench`: run the emulator, and operate a bench without printing."""

from __future__ import annotations

import argparse
import importlib
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from inkloop.bench.emulation import Emulation, emulation_of
from inkloop.components import devices
from inkloop.components.bench import Bench, load
from inkloop.components.catalog import MAPPED
from inkloop.errors import InkloopError
from inkloop.printing.device_log import live_words
from inkloop.printing.listening import check_listening, local_port
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop.tables.bench_faults import read_fault

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
    bench = Bench(scenario.tables.bench)
    if mapped := [name for name, table in scenario.tables.components.items() if table.kind == MAPPED]:
        if action != "stop":
            raise InkloopError(
                f"{scenario.source}: {action} is for inkloop's own nodes; this rig goes by its mapping, which knows "
                "[[stop]] steps alone"
            )
        stop_rig = load("inkloop_hardware.mapped.mapped_stop", "stop_rig")
        for name in mapped:
            _show(stop_rig(bench.rig.settings, Path(scenario.options(name)["mapping"]), scenario.job()), console)
        return 0
    if action in ("stop", "release"):
        stop = importlib.import_module("inkloop_hardware.devices.stop")
        send = stop.request_stop if action == "stop" else stop.release_stop
        _show(send(bench.rig.settings), console)
        return 0
    commands = importlib.import_module("inkloop_hardware.devices.commands")
    job = next(
        (
            devices.job_with_overrides(scenario.job(name), table.options)
            for name, table in scenario.tables.components.items()
            if table.kind == "hardware.printer"
        ),
        scenario.job(),
    )
    check_listening(scenario)
    with live_words(console, None), bench.rig as rig:
        if action == "status":
            lines = commands.status(rig)
        elif action == "clear":
            lines = commands.clear_all(rig, give_up=give_up)
        elif action == "dry-run":
            lines = commands.dry_run(rig, job, cure_ms=scenario.tables.bench.cure_ms)
        else:
            lines = getattr(commands, action)(rig)
        _show(lines, console)
    return 0


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

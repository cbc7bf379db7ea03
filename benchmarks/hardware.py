"""A layer on the emulator through the whole chain of processes, and its frame time on a real bus."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

import can
import numpy as np
from rich.table import Table

from benchmarks.bus_time import BusTime, bus_time
from inkloop.component import Ink, Job
from inkloop.units import KILO
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import make_ready
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.vocabulary import Node

TIMES_MS = {"pass_ms": 30, "scan_ms": 30, "move_ms": 5, "home_ms": 5, "gate_ms": 5}
CURE_MS = 10
LOG = "traffic.blf"


def measure() -> Table:
    """Seconds of each part of a layer; mechanical times shortened to about a quarter of a second."""
    table = Table(
        title="a layer in four passes on the emulator (moves, passes, cures and scan last 0.25 s of it)",
        caption="bus time: its frames alone, with stuff bits by content, in brackets with most; all traffic is logged",
    )
    for heading in ("what", "bytes", "took", "at most", "kB/s", "frames", "bus 500 kbit/s", "bus 1 Mbit/s"):
        table.add_column(heading, justify="left" if heading == "what" else "right")
    for side, inks, limits in ((100, 1, ("2 s", "")), (1000, 1, ("6 s", "90 s")), (1000, 2, ("", ""))):
        for row in _layer(side, inks, limits):
            table.add_row(*row)
        table.add_section()
    return table


def _layer(side: int, inks: int, limits: tuple[str, str]) -> Iterator[tuple[str, ...]]:
    job = _job(side, inks)
    pattern = np.random.default_rng(1).integers(0, inks + 1, (side, side))
    name = f"{side} x {side}, {'one ink' if inks == 1 else 'two inks'}: "
    size = 8 + (side * side * inks + 7) // 8
    with tempfile.TemporaryDirectory() as folder:
        with _steps(job, Path(folder)) as steps:
            took = _seconds(lambda: steps.print_layer(1, pattern))
            scan = perf_counter()
            blob = steps.scan(1)
            scan = perf_counter() - scan
        printing, scanning = _of_each(Path(folder) / LOG)
    yield name + "pattern, passes, cures", *_figures(size, took, limits[0] if side > 100 else "", printing)
    yield name + "scan, map", *_figures(len(blob), scan, limits[1], scanning)
    if side == 100:
        both = BusTime(*(a + b for a, b in zip(vars(printing).values(), vars(scanning).values(), strict=True)))
        yield name + "whole layer", *_figures(size + len(blob), took + scan, limits[0], both)


def _job(side: int, inks: int) -> Job:
    mask = np.ones((side, side), np.bool_)
    return Job(side, side, 1e-4, np.zeros((side, side)), mask, inks=(Ink(),) * inks, passes=4)


@contextmanager
def _steps(job: Job, folder: Path) -> Iterator[LayerSteps]:
    """The steps of a bench that is ready; its traffic is logged in the folder."""
    with EmulatedBench({"nx": job.nx, "ny": job.ny, **TIMES_MS}) as bench:
        settings = BusSettings("slcan", bench.channel, 500_000, traffic_log=Path(LOG))
        with Rig(settings, folder=folder) as rig:
            yield LayerSteps(rig, job, make_ready(rig, tuple(Node)), cure_ms=CURE_MS)


def _seconds(call: Callable[[], object]) -> float:
    begin = perf_counter()
    call()
    return perf_counter() - begin


def _of_each(log: Path) -> tuple[BusTime, BusTime]:
    """Bus time of printing and of scanning: what comes before the first request to the profiler after the pattern."""
    frames = [(frame.arbitration_id, bytes(frame.data)) for frame in can.LogReader(log)]
    last_of_cure = max(k for k, (identifier, _) in enumerate(frames) if identifier == 0x645)
    return bus_time(frames[:last_of_cure]), bus_time(frames[last_of_cure:])


def _figures(size: int, took: float, limit: str, bus: BusTime) -> tuple[str, ...]:
    at_500, at_1000 = (bus.seconds(bitrate) for bitrate in (500e3, 1e6))
    times = (f"{mean:.2f} s ({worst:.2f})" for mean, worst in (at_500, at_1000))
    return f"{size:,}", f"{took:.2f} s", limit, f"{size / took / KILO:.0f}", f"{bus.frames:,}", *times

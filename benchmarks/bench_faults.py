"""A layer over a bus that loses frames, and how fast nodes de-energise themselves, by their own clocks."""

from __future__ import annotations

import logging
import os
import signal
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from statistics import median
from struct import pack as pack_bytes
from time import monotonic, perf_counter, sleep

import numpy as np
from rich.console import Group
from rich.table import Table

from inkloop.units import MS_PER_S
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.connection import BusConnection
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.errors import BusError, HardwareError
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.height_map_bytes import read_map
from inkloop_hardware.protocol.node_state import NodeTimes
from inkloop_hardware.protocol.pattern_bytes import PatternBytes
from inkloop_hardware.protocol.records import StopRequest, pack
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.vocabulary import Node, Source

TIMES_MS = {"pass_ms": 30, "scan_ms": 30, "gate_ms": 5}
SIDE = 283
"""Cells along x and y: 2 bits each are 20 kB."""
SEEDS = range(5)
REPEATS = 10
LONG_CURE_MS, LIMIT_S = 9000, 60.0


LOSS_HEADS = ("loss", "seed", "took", "at most", "asked again", "gate pulses", "CRC", "map")
REACTION_HEADS = ("what happens", "counted from", "median [ms]", "longest [ms]", "at most [ms]")


def measure() -> Group:
    """Both tables."""
    losing = f"pattern, 4 passes, scan and map of {SIDE} x {SIDE} cells at random frame loss both ways"
    lit = f"the lamp is lit, then something happens: time to its end by the node's clock, {REPEATS} times"
    return Group(_table(losing, LOSS_HEADS, losses()), _table(lit, REACTION_HEADS, reactions()))


def _table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> Table:
    table = Table(title=title)
    for head in heads:
        table.add_column(head.replace("[", r"\["))
    for row in rows:
        table.add_row(*row)
    return table


def losses() -> Iterator[tuple[str, ...]]:
    """A row for each print over a bus that loses frames."""
    for probability, seeds, limit in ((0.0, range(1), "-"), (1e-4, range(1), "-"), (1e-3, SEEDS, "15 s")):
        for seed in seeds:
            faults = [f"loss:probability={probability},seed={seed}"] if probability else []
            took, again, pulses, crc, whole = _layer(faults)
            words = ("equal" if crc else "DIFFERS", "whole" if whole else "SHORT")
            yield f"{probability:g}", str(seed), f"{took:.1f} s", limit, str(again), str(pulses), *words


def _layer(faults: list[str]) -> tuple[float, int, int, bool, bool]:
    """Seconds; requests repeated; gate pulses; whether the head has the pattern, and the map every cell."""
    pattern = np.random.default_rng(1).integers(0, 3, (SIDE, SIDE))
    blob = PatternBytes.of(pattern, passes=4, materials=2).plain
    with _cleared(faults) as rig:
        head, profiler = rig.link(Node.HEAD), rig.link(Node.PROFILER)
        begin = perf_counter()
        head.download(1, blob)
        for number in range(4):
            with rig.enabled(gate=True, motion=True):
                head.routine(Routine.PASS, Key(rig.job, 1, number), bytes([number]), limit_s=LIMIT_S)
        profiler.routine(Routine.SCAN, Key(rig.job, 1), limit_s=LIMIT_S)
        _, valid = read_map(profiler.upload(1), SIDE, SIDE)
        took = perf_counter() - begin
        state = head.state()
        again = head.counts.repeated + profiler.counts.repeated
        return took, again, state.gate_pulses, state.pattern_crc == zlib.crc32(blob), bool(valid.all())


def reactions() -> Iterator[tuple[str, ...]]:
    """A row for each event that switches the lamp off."""
    logging.getLogger("inkloop_hardware").setLevel(logging.ERROR)  # stop requests and lost masters are meant here
    for what, since, happen, limit_ms in (
        ("the master is killed", "the last MasterAlive", _kill, 350),
        ("the enable is dropped", "the clock asked before", _drop, 100),
        ("a stop request", "the clock asked before", _stop, 10),
    ):
        with EmulatedBench(TIMES_MS) as bench:
            settings = BusSettings("slcan", bench.channel, 500_000)
            found = [MS_PER_S * _reaction(settings, happen) for _ in range(REPEATS)]
        yield what, since, f"{median(found):.0f}", f"{max(found):.0f}", f"{limit_ms}"


class Onlooker:
    """A second adapter on the bus, which polls the lamp and never sends a keep-alive."""

    def __init__(self, settings: BusSettings) -> None:
        self.adapter = Adapter(settings)
        self.codec = Codec()
        self.lamp = Link(Node.CURE, self.codec, self, "the bus of the benchmark")
        self._answer_id = self.codec.answer_id(Node.CURE)

    def begin(self) -> None:
        """Nothing to note."""

    def check(self) -> None:
        """Send nothing."""

    def now(self) -> float:
        """Seconds."""
        return monotonic()

    def send(self, frames: Sequence[Frame]) -> None:
        """Sends frames."""
        for frame in frames:
            self.adapter.send(frame)

    def receive(self, wait_s: float) -> bytes | None:
        """The next frame of an answer of the lamp."""
        until = monotonic() + wait_s
        while True:
            message = self.adapter.bus.recv(max(0.0, until - monotonic()))
            if message is None or message.arbitration_id == self._answer_id:
                return bytes(message.data) if message else None

    def stop(self, active: bool, counter: int) -> None:
        """A stop request."""
        self.send([pack(self.codec, StopRequest(active, Source.OPERATOR), counter)])

    def times_when(self, is_so: Callable[[NodeTimes], bool]) -> NodeTimes:
        """What the node noted, once it is so."""
        while not is_so(times := self.lamp.times()):
            sleep(0.001)
        return times


def _reaction(settings: BusSettings, happen: Callable[[Rig, Onlooker], None]) -> float:
    """Seconds from what happens to the end of the lamp."""
    onlooker = Onlooker(settings)
    rig = Rig(settings)
    with suppress(BusError), rig:
        _clear(rig)
        with suppress(HardwareError), rig.enabled(lamp=True):
            cure = pack_bytes(">BBH", 0x31, 1, Routine.CURE) + bytes(Key(rig.job, 0)) + pack_bytes(">H", LONG_CURE_MS)
            rig.link(Node.CURE).requests.client.conn.send(cure)
            while not ((status := rig.status(Node.CURE)) and status.lamp_on):
                rig.keep_alive()
                sleep(0.005)
            lit = onlooker.lamp.times()
            happen(rig, onlooker)
    ended = onlooker.times_when(lambda times: times.lamp_off > times.lamp_on)
    onlooker.adapter.close()
    return ended.lamp_off - (ended.master_alive if happen is _kill else lit.now)


def _clear(rig: Rig) -> None:
    rig.wait_for(Node)
    for node in Node:
        rig.link(node).routine(Routine.CLEAR, Key(rig.job, 0), b"\1", limit_s=LIMIT_S)


def _kill(rig: Rig, onlooker: Onlooker) -> None:
    bus = rig.supervision.bus
    assert isinstance(bus, BusConnection)
    os.kill(bus.process_id, signal.SIGKILL)


def _drop(rig: Rig, onlooker: Onlooker) -> None:
    """Leaving the step is enough."""


def _stop(rig: Rig, onlooker: Onlooker) -> None:
    for counter, active in enumerate((True, False, False)):  # a release takes two frames in a row
        onlooker.stop(active, counter)


@contextmanager
def _cleared(faults: list[str]) -> Iterator[Rig]:
    with (
        EmulatedBench({"nx": SIDE, "ny": SIDE, **TIMES_MS}, faults=faults) as bench,
        Rig(BusSettings("slcan", bench.channel, 500_000)) as rig,
    ):
        _clear(rig)
        yield rig

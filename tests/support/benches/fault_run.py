"""A rig on the emulator with injected faults, and the required state of the part afterwards."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.emulated_bench import EmulatedBench
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.node_state import NodeState
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, unpack
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from inkloop_hardware.protocol.transfer_bytes import read_map
from support.benches import node_bench

SIDE = 9
PATTERN = np.random.default_rng(2).integers(0, 3, (SIDE, SIDE)).astype(np.uint8)
BLOB = node_bench.pattern_blob(PATTERN)
SILENCE_S = 1.0
"""Of a node and of the master, until the other side takes it for lost: a busy machine is no fault of the bench."""
PATIENT = dict.fromkeys(("alive_ms", "watchdog_ms"), 1e3 * SILENCE_S)
FAST: dict[str, Any] = {"pass_ms": 5, "scan_ms": 5, "move_ms": 2, "home_ms": 2, "gate_ms": 1}
LIMIT_S = 600.0
"""Ends a test that hangs; every wait is for an event."""
CURE_MS = 10
JOB = 7


@dataclass
class FaultRun:
    """A bench and its master; `opened` are the passes that were answered as done."""

    bench: EmulatedBench
    rig: Rig

    def clear(self, option: int = 0) -> None:
        self.rig.wait_for(Node, LIMIT_S)
        for node in Node:
            self.rig.link(node).routine(Routine.CLEAR, Key(JOB, 0), bytes([option]), limit_s=LIMIT_S)

    def jet(self, number: int, *, layer: int = 1, limit_s: float = LIMIT_S) -> Outcome:
        key = Key(JOB, layer, number)
        with self.rig.enabled(gate=True, motion=True):
            return self.rig.link(Node.HEAD).routine(Routine.PASS, key, bytes([number]), limit_s=limit_s)

    def cure(self, number: int, *, layer: int = 1, milliseconds: int = CURE_MS) -> Outcome:
        key = Key(JOB, layer, number)
        with self.rig.enabled(lamp=True):
            return self.rig.link(Node.CURE).routine(Routine.CURE, key, milliseconds.to_bytes(2, "big"), limit_s=LIMIT_S)

    def print_layer(self, passes: int = 4) -> None:
        self.rig.link(Node.HEAD).download(1, BLOB)
        for number in range(passes):
            self.jet(number)
            self.cure(number)

    def scan(self, attempt: int = 1, layer: int = 1) -> NDArray[np.float64]:
        """Heights as they are [m]; the sensor is exact."""
        profiler = self.rig.link(Node.PROFILER)
        profiler.routine(Routine.SCAN, Key(JOB, layer, 0, attempt), limit_s=LIMIT_S)
        return read_map(profiler.upload(layer), SIDE, SIDE)[0]

    def state(self, node: Node = Node.HEAD) -> NodeState:
        return self.rig.link(node).state()


@contextmanager
def faulty(*faults: str, cleared: bool = True, reopen_s: float = 10.0, **options: float) -> Iterator[FaultRun]:
    """A bench with faults, and a master of job JOB on it."""
    with EmulatedBench({"nx": SIDE, "ny": SIDE, **FAST, **PATIENT, **options}, faults=faults) as bench:
        settings = replace(settings_of(bench), reopen_s=reopen_s)
        rig = Rig(settings)
        rig.job = JOB
        with rig:
            run = FaultRun(bench, rig)
            rig.wait_for(Node, LIMIT_S)
            if cleared:
                run.clear()
            yield run


def settings_of(bench: EmulatedBench) -> BusSettings:
    return BusSettings("slcan", bench.channel, 500_000, grace_s=SILENCE_S, silence_s=SILENCE_S)


def wait_for_fault(bench: EmulatedBench, node: Node, fault: Fault) -> None:
    """Until a node reports this fault to a listener that sends nothing."""
    adapter, codec = Adapter(settings_of(bench)), Codec()
    status, until = codec.message(f"{node}{NodeStatus.message}").frame_id, time.monotonic() + LIMIT_S
    while time.monotonic() < until:
        for message in adapter.receive(1.0):
            if message.arbitration_id == status:
                found = unpack(codec, codec.decode(Frame(status, bytes(message.data))))
                if isinstance(found, NodeStatus) and found.fault is fault:
                    return adapter.close()
    raise AssertionError(f"{node} never reported {fault.name}")


@contextmanager
def looked_at(run: FaultRun) -> Iterator[FaultRun]:
    """The same bench with a new master, to inspect it after the first one is gone."""
    run.rig.detach()
    rig = Rig(settings_of(run.bench))
    rig.job = JOB
    try:
        with rig:
            rig.wait_for(Node, LIMIT_S)
            yield FaultRun(run.bench, rig)
    finally:
        run.rig.attach()


def wait_until(true: Callable[[], bool]) -> None:
    """Until it is so."""
    until = time.monotonic() + LIMIT_S
    while not true():
        assert time.monotonic() < until
        time.sleep(0.02)


@lru_cache
def printed(passes: tuple[int, ...]) -> NDArray[np.float64]:
    """Heights [m] after these passes of PATTERN, on nodes to which nothing happens."""
    with node_bench.NodeBench(nx=SIDE, ny=SIDE, **FAST) as bench:
        bench.ready()
        assert bench.download(BLOB, 1) == 0
        for number in passes:
            assert bench.jet(1, number) == node_bench.DONE
        found = np.round(bench.surface / 1e-7) * 1e-7
    return found

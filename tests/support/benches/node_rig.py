"""A rig without a bus process: links to the nodes of the firmware in this process, by an injected clock."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from struct import unpack_from
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.component import Component, Job, Values
from inkloop.testing import job as small_job
from inkloop_hardware.errors import NodeRefused
from inkloop_hardware.link.link import Link
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, State
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from support.benches import node_bench
from support.benches.faulty_wire import CODEC, FaultyWire

FOUR = replace(small_job(), passes=4)
FULL = np.ones((FOUR.nx, FOUR.ny), np.int32)
NUMBERS = {node: number for number, node in enumerate(Node)}

if TYPE_CHECKING:
    Base = Any  # then a NodeRig may stand where a Rig is expected
else:
    Base = object


def bench(part: Job = FOUR, **options: Any) -> node_bench.NodeBench:
    """Nodes for a part, whose passes and scans take 5 ms."""
    return node_bench.NodeBench(**{"nx": part.nx, "ny": part.ny, "pass_ms": 5, "scan_ms": 5, **options})


def print_layer(printer: Component, layer: int, pattern: np.ndarray = FULL) -> Values:
    """Outputs after the step in which a layer is commanded."""
    inputs = {"pattern": pattern.astype(np.int32), "drop_level": np.ones(pattern.shape, np.int32)}
    return printer.do_step(0, 1_000_000_000, inputs | {"layer_command": np.asarray(layer, np.int32)})


class NodeLink(Link):
    """One node on a wire without faults; `asked` are the routines that were started."""

    def __init__(self, rig: NodeRig, node: Node) -> None:
        super().__init__(node, CODEC, FaultyWire(rig.bench, NUMBERS[node]), "a wire")
        self._rig = rig
        self.asked: list[tuple[Routine, Key, bytes]] = []

    def download(self, layer: int, blob: bytes, *, coded: bool = False, progress: Any = None) -> None:
        if coded and not self._rig.takes_coded:
            raise NodeRefused("head: no coded patterns", 0x31)
        super().download(layer, blob, coded=coded, progress=progress)
        self._rig.downloads.append((layer, coded))

    def routine(self, routine: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
        self.asked.append((routine, key, option))
        return super().routine(routine, key, option, limit_s=limit_s)


class NodeRig(Base):
    """Stands for `inkloop_hardware.link.rig.Rig`. `enables` are those of every step so far, in their order."""

    def __init__(self, bench: node_bench.NodeBench, job: int = 7) -> None:
        self.bench, self._job = bench, job
        self.users, self.takes_coded, self.kept_alive = 0, True, 0
        self.valid_share, self.on_part = 0.0, True
        self.enables: list[int] = []
        self.downloads: list[tuple[int, bool]] = []
        self._links = {node: NodeLink(self, node) for node in Node}
        self._enable(0)

    @property
    def session(self) -> int:
        return 1

    @property
    def is_open(self) -> bool:
        return self.users > 0

    @property
    def job(self) -> int:
        return self._job

    @job.setter
    def job(self, number: int) -> None:
        self._job = number
        self._enable(0)

    def _enable(self, enables: int) -> None:
        self.bench.master = node_bench.MasterAlive(enables, 1, self._job)
        self.bench.send_keep_alive()
        self.bench.tick(5)

    def attach(self) -> None:
        self.users += 1
        self.bench.tick(100)

    def detach(self) -> None:
        self.users -= 1

    def link(self, node: Node) -> NodeLink:
        return self._links[node]

    def keep_alive(self) -> None:
        self.kept_alive += 1

    def pause(self, seconds: float) -> None:
        self.keep_alive()

    @contextmanager
    def enabled(self, *, lamp: bool = False, gate: bool = False, motion: bool = False) -> Iterator[None]:
        enables = node_bench.LAMP * lamp | node_bench.GATE * gate | node_bench.MOTION * motion
        self.enables.append(enables)
        self._enable(enables)
        try:
            yield
        finally:
            self._enable(0)

    def wait_for(self, nodes: Any, limit_s: float = 3.0) -> None: ...

    def check_alone(self) -> None: ...

    def status(self, node: Node) -> NodeStatus:
        state = self.link(node).state()
        flags, fault, boots = (False, False, True, True), Fault(state.cause), state.boots % 256
        return NodeStatus(node, *flags, State(state.state), state.done, fault, state.layer, boots, state.unknown, 1)

    def records(self, node: Node) -> list[tuple[int, ...]]:
        """(kind, step, pass) of a node's journal, oldest first."""
        answer = self.bench.raw(b"\x22\x01\x10", NUMBERS[node])[3:]
        return [unpack_from("3B", answer, at + 4) for at in range(0, len(answer), 40)][::-1]

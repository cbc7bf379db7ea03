"""A wait ends with a message when its node is gone or in fault, and the control loop counts as alive while it waits."""

from __future__ import annotations

from dataclasses import replace

import pytest

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import AnotherMaster, NodeLost, NodeStopped
from inkloop_hardware.link import rig as rig_module
from inkloop_hardware.link.node_watch import NodeWatch
from inkloop_hardware.link.rig import ANSWER_GRACE_S, NodeWire, Rig
from inkloop_hardware.protocol.records import NodeFault
from inkloop_hardware.protocol.vocabulary import Fault, Node, State
from support.benches.faulty_wire import CODEC
from support.benches.node_status import IDLE_HEAD

STATUS = replace(IDLE_HEAD, node=Node.CURE, lamp_on=True, state=State.CURING)


class Bench:
    """Supervision as a wire needs it: one lamp that is on, by an injected clock."""

    codec = CODEC

    def __init__(self) -> None:
        self.now = 0.0
        self.seen = NodeWatch(Node.CURE)
        self.seen.take_status(0.0, STATUS, 0)
        self.words = 0
        self.other = ""

    def keep_alive(self) -> None:
        self.words += 1

    def check(self, nodes: tuple[Node, ...]) -> None:
        if trouble := self.seen.trouble(self.now):
            raise NodeLost(trouble)

    def check_alone(self) -> None:
        if self.other:
            raise AnotherMaster(self.other)

    def watch(self, node: Node) -> NodeWatch:
        return self.seen


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    made = Bench()
    monkeypatch.setattr(rig_module.time, "monotonic", lambda: made.now)  # type: ignore[attr-defined]
    return made


def wire_of(bench: Bench) -> NodeWire:
    wire = NodeWire(bench, Node.CURE)  # type: ignore[arg-type]
    wire.begin()
    return wire


def test_each_slice_of_a_wait_reports_that_the_loop_is_alive(bench: Bench) -> None:
    wire = wire_of(bench)
    for _ in range(5):
        wire.check()
    assert bench.words == 6


def test_node_that_falls_silent_ends_the_wait(bench: Bench) -> None:
    wire = wire_of(bench)
    wire.check()
    bench.now = 0.31
    with pytest.raises(NodeLost, match=r"cure has been silent for 0\.3 s"):
        wire.check()


def test_node_that_enters_fault_is_given_a_moment_to_report_it(bench: Bench) -> None:
    wire = wire_of(bench)
    bench.seen.take_fault(NodeFault(Node.CURE, Fault.GATE_NOT_CONFIRMED, 1, 3, 0.1))
    wire.check()
    bench.seen.take_status(0.1, replace(STATUS, state=State.FAULT, fault=Fault.GATE_NOT_CONFIRMED), 1)
    bench.now = ANSWER_GRACE_S
    wire.check()
    bench.now = ANSWER_GRACE_S + 0.01
    with pytest.raises(NodeStopped, match=r"de-energised state \(gate not confirmed\).*clear") as caught:
        wire.check()
    assert caught.value.fault is Fault.GATE_NOT_CONFIRMED


def test_each_request_gives_a_fallen_node_its_own_moment(bench: Bench) -> None:
    """Who else is on the bus is the reason that counts."""
    wire = wire_of(bench)
    for second, counter in ((1, 1), (2, 3)):
        bench.seen.take_status(second, replace(STATUS, state=State.FAULT, fault=Fault.LAMP_TIME), counter)
        bench.now = float(second)
        wire.check()
        bench.seen.take_status(second, STATUS, counter + 1)
        wire.begin()
    bench.seen.take_status(3.0, replace(STATUS, state=State.SAFE, fault=Fault.TWO_MASTERS), 5)
    bench.now, bench.other = 3.0, "another master is active"
    wire.check()
    bench.now += ANSWER_GRACE_S + 0.01
    with pytest.raises(NodeStopped, match="during a request; another master is active"):
        wire.check()


def test_node_that_was_off_before_may_be_asked(bench: Bench) -> None:
    off = replace(STATUS, state=State.SAFE, fault=Fault.MASTER_LOST)
    bench.seen.take_status(0.1, off, 1)
    wire = wire_of(bench)
    for number in range(2, 12):
        bench.now = number / 10
        bench.seen.take_status(bench.now, off, number)
        bench.seen.take_fault(NodeFault(Node.CURE, Fault.MASTER_LOST, 1, 3, 0.1))
        wire.check()


@pytest.mark.parametrize("number", [0, -1, 1 << 32])
def test_job_is_a_number_of_32_bits_and_not_0(number: int) -> None:
    rig = Rig(BusSettings())
    with pytest.raises(ValueError, match=f"job is {number}, expected 1 to 4294967295"):
        rig.job = number
    assert 1 <= rig.job <= 0xFFFFFFFF
    assert 1 <= rig.session <= 0xFFFF

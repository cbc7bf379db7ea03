"""A node that restarts during a print: the print continues where nothing is unknown, else a person is asked."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop_hardware.devices.printer import Printer
from inkloop_hardware.devices.profiler import Profiler
from inkloop_hardware.devices.readiness import NotReady, retry_after_recovery
from inkloop_hardware.errors import (
    BusDisconnected,
    HardwareError,
    LinkTimeout,
    NodeLost,
    NodeRefused,
    NodeStopped,
    TransferError,
)
from inkloop_hardware.protocol.node_state import Flags
from inkloop_hardware.protocol.records import Fault, Node, State
from inkloop_hardware.protocol.services import Routine
from support.benches import node_bench
from support.benches.node_bench import NodeBench
from support.benches.node_rig import FOUR, FULL, NodeRig, print_layer
from support.benches.node_rig import bench as of_a_part

pytestmark = pytest.mark.compiled


def bench() -> NodeBench:
    return of_a_part(pass_ms=20, variation=0.2, printer_seed=3)


def started(rig: NodeRig) -> Printer:
    printer = Printer(FOUR, rig, cure_ms=20)
    printer.initialize(0, {"layer_command": np.int32(0)})
    return printer


def before(rig: NodeRig, node: Node, routine: Routine, nth: int, happen: Callable[[], None]) -> None:
    """Something happens before the nth request for a routine."""
    link: Any = rig.link(node)
    ask, count = link.routine, 0

    def watched(asked: Routine, *rest: Any, **more: Any) -> Any:
        nonlocal count
        count += asked == routine
        if asked == routine and count == nth:
            happen()
        return ask(asked, *rest, **more)

    link.routine = watched


@pytest.mark.parametrize("node", [Node.HEAD, Node.STAGE, Node.CURE])
@pytest.mark.parametrize("nth", [1, 3])
def test_print_continues_with_a_node_that_restarts_between_steps_and_every_pass_is_jetted_once(
    node: Node, nth: int
) -> None:
    routine = {Node.HEAD: Routine.PASS, Node.STAGE: Routine.MOVE, Node.CURE: Routine.CURE}[node]
    with bench() as nodes, bench() as same:
        print_layer(started(NodeRig(same)), 1)
        rig = NodeRig(nodes)
        printer = started(rig)
        before(rig, node, routine, nth, lambda: nodes.power_up(list(Node).index(node)))
        assert print_layer(printer, 1)["layers_printed"] == 1
        assert nodes.gate_openings == nodes.lamp_pulses == 4
        np.testing.assert_array_equal(nodes.surface, same.surface)


def test_profiler_that_restarts_scans_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        profiler = Profiler(FOUR, rig)
        profiler.initialize(0, {"layers_printed": np.int32(0)})
        before(rig, Node.PROFILER, Routine.SCAN, 1, lambda: nodes.power_up(node_bench.PROFILER))
        assert profiler.do_step(0, 1, {"layers_printed": np.int32(0)})["layers_scanned"] == 0


def test_head_that_restarts_within_a_pass_asks_for_a_person_and_names_the_pass() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(rig)
        head: Any = rig.link(Node.HEAD)
        ask = head.routine

        def dies(routine: Routine, key: Any, option: bytes = b"", **more: Any) -> Any:
            if routine != Routine.PASS or key.pass_ != 2:
                return ask(routine, key, option, **more)
            nodes.raw(nodes.routine(node_bench.Routine.PASS, layer=1, which=2, option=option, job=rig.job))
            nodes.tick(10)
            nodes.power_up(node_bench.HEAD)
            raise NodeRefused("head: it began and gave up", 0x26)

        head.routine = dies
        with pytest.raises(
            NotReady, match=r"gave up\n.*pass 3 of layer 1.*progress is unknown.*inkloop bench clear SCENARIO"
        ):
            print_layer(printer, 1)
        head.routine, openings = ask, nodes.gate_openings
        assert nodes.clear(node_bench.HEAD, 1) == node_bench.DONE
        found = print_layer(printer, 1)
        assert (found["layers_printed"], found["layer_unknown"]) == (1, True)
        assert found["droplets_a"] == np.count_nonzero(FULL[0::2])
        assert nodes.gate_openings == openings
        resumed = Printer(FOUR, rig, cure_ms=20)
        resumed.initialize(0, {"layer_command": np.int32(1)})
        resumed.restore(printer.save())
        for name, value in print_layer(resumed, 1).items():
            assert value == found[name], f"{name} of a run that is resumed now"
        found = print_layer(printer, 2)
        assert (found["layers_printed"], found["layer_unknown"]) == (2, False)


@pytest.mark.parametrize("state", [State.SAFE, State.FAULT])
def test_refused_work_is_done_again_after_a_node_stopped(state: State) -> None:
    done = []

    def work() -> int:
        done.append(1)
        if len(done) == 1:
            raise NodeRefused("head: not now", 0x22)
        return len(done)

    with bench() as nodes:
        rig = NodeRig(nodes)
        link: Any = rig.link(Node.HEAD)
        stopped = replace(link.state(), state=state)
        link.state = lambda: stopped
        assert retry_after_recovery(rig, (Node.HEAD,), work, is_start=True) == 2


class Ready:
    """A rig whose nodes are well; `waited`: the limits of its waits [s]."""

    def __init__(self) -> None:
        self.waited: list[float | None] = []

    def wait_for(self, nodes: Any, limit_s: float | None = None) -> None:
        self.waited.append(limit_s)

    def link(self, node: Node) -> Any:
        return SimpleNamespace(state=lambda: SimpleNamespace(state=State.IDLE, flags=Flags(0)))


def failing(*errors: Exception) -> Callable[[], int]:
    """Work that raises these errors one after the other, then returns how many they were."""
    left = list(errors)

    def work() -> int:
        if left:
            raise left.pop(0)
        return len(errors)

    return work


@pytest.mark.parametrize("kind", [NodeLost, BusDisconnected, LinkTimeout, NodeStopped])
def test_work_is_done_again_three_times_and_no_more(kind: type[HardwareError]) -> None:
    more = (Fault.MASTER_LOST,) if kind is NodeStopped else ()

    def again(times: int) -> tuple[int, list[float | None]]:
        rig: Any = Ready()
        errors = [kind("not there", *more) for _ in range(times)]
        return retry_after_recovery(rig, (Node.HEAD,), failing(*errors), is_start=True), rig.waited

    wait_s = 20.0 if kind is BusDisconnected else None  # a person plugs it in again
    assert again(0) == (0, [])
    assert again(3) == (3, 3 * [wait_s])
    with pytest.raises(kind):
        again(4)


def test_transfer_that_fails_at_nodes_that_are_well_is_an_error() -> None:
    for error in (TransferError("altered"), NodeRefused("head: not now", 0x24)):
        rig: Any = Ready()
        with pytest.raises(type(error)):
            retry_after_recovery(rig, (Node.HEAD,), failing(error), is_start=True)
        assert rig.waited == [None], "they were looked at once"


def test_transfer_that_a_fallen_node_broke_off_is_done_again() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        assert retry_after_recovery(rig, (Node.HEAD,), failing(TransferError("cut off"))) == 1, "it was SAFE"
        assert rig.link(Node.HEAD).state().state is State.IDLE


def test_recovery_is_logged_with_its_cause_and_the_nodes_that_had_stopped(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING, "inkloop_hardware")
    with bench() as nodes:
        rig = NodeRig(nodes)
        for node in (node_bench.HEAD, node_bench.CURE):
            nodes.power_up(node)
        for error in (TransferError("cut off"), NodeLost("it was silent")):
            assert retry_after_recovery(rig, (Node.HEAD, Node.CURE), failing(error)) == 1
    assert caplog.messages == [
        "cut off",
        "head, cure: no step is unknown, the print continues",
        "it was silent",
        "all nodes are present again: no step is unknown, the print continues",
    ]


def test_refusal_of_a_node_that_did_not_fall_ends_the_run_at_once() -> None:
    with bench() as nodes:
        rig = NodeRig(nodes)
        printer = started(rig)
        nodes.broken(node_bench.Broken.NOT_READY)
        with pytest.raises(NodeRefused):
            print_layer(printer, 1)
        asked = [routine for routine, *_ in rig.link(Node.HEAD).asked]
        assert asked.count(Routine.PASS) == 1

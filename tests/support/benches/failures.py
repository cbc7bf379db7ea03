"""Failures of a print between real processes, one by one: what the master gets, and what the node itself records."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from inkloop.component import Ink, Job
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import make_ready
from inkloop_hardware.errors import BusDisconnected, HardwareError
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import JournalRecord, Step
from inkloop_hardware.protocol.records import Node, Source, StopRequest, pack
from support.benches.fault_run import (
    BLOB,
    LIMIT_S,
    PATTERN,
    SIDE,
    FaultRun,
    faulty,
    looked_at,
    settings_of,
    wait_until,
)

HEADS = ("failure", "fault of the emulator", "the master gets", "state, cause", "newest record")
LONG_MS = 1500
Row = tuple[str, str, str, str, str]


def in_second_pass(run: FaultRun) -> None:
    """The first pass is jetted and cured; the fault comes in the second one."""
    run.rig.link(Node.HEAD).download(1, BLOB)
    run.jet(0)
    run.cure(0)
    run.jet(1)


def in_a_pass_beyond_its_time(run: FaultRun) -> None:
    run.rig.link(Node.HEAD).download(1, BLOB)
    run.jet(0, limit_s=0.5 * LONG_MS / 1e3)


def in_transfer(run: FaultRun) -> None:
    run.rig.link(Node.HEAD).download(1, BLOB)


def in_third_pass(run: FaultRun) -> None:
    run.print_layer(2)
    run.jet(2)


def in_scan(run: FaultRun) -> None:
    in_second_pass(run)
    run.cure(1)
    run.scan()


def with_records_lost(run: FaultRun) -> None:
    """The head restarts with records that it cannot read; a print is not made ready."""
    in_second_pass(run)
    make_ready(run.rig, tuple(Node))


def with_another_pattern(run: FaultRun) -> None:
    job = Job(SIDE, SIDE, 1e-4, np.zeros((SIDE, SIDE)), np.ones((SIDE, SIDE), np.bool_), inks=(Ink(), Ink()), passes=4)
    run.print_layer(1)
    steps = LayerSteps(run.rig, job, make_ready(run.rig, tuple(Node)), cure_ms=10)
    steps.print_layer(1, 2 - PATTERN.astype(np.int32))


def with_a_stop_request(run: FaultRun) -> None:
    button, codec = Adapter(settings_of(run.bench)), Codec()
    try:
        in_transfer(run)
        button.send(pack(codec, StopRequest(True, Source.OPERATOR), 0))
        run.jet(0)
    finally:
        button.close()


NEVER_WHOLE = "corruption:id=0x640,step=download,byte=6,count=1000000"
STUCK, BAD_CHECK = (f"{kind}:id=0x20,count=1000,step=pass,pass=1" for kind in ("stuck-counter", "bad-check"))
SHORT_MS = 5
SECOND = "node=head,step=pass,pass=1"
UNREADABLE = f"unreadable:{SECOND}"

FAILURES: tuple[tuple[str, str, Callable[[FaultRun], None], Node, int], ...] = (
    ("no answer to a request", "loss:id=0x641,step=pass,pass=1", in_second_pass, Node.HEAD, SHORT_MS),
    ("a pass takes longer than its limit", "", in_a_pass_beyond_its_time, Node.HEAD, LONG_MS),
    ("a pattern altered again and again", NEVER_WHOLE, in_transfer, Node.HEAD, SHORT_MS),
    ("answers doubled", "repeated-answer:count=1000", in_second_pass, Node.HEAD, SHORT_MS),
    ("no heartbeat of a node", "death:node=head,step=pass,pass=1,frames=40", in_second_pass, Node.HEAD, LONG_MS),
    ("counter of MasterAlive stuck", STUCK, in_second_pass, Node.HEAD, LONG_MS),
    ("check byte of MasterAlive wrong", BAD_CHECK, in_second_pass, Node.HEAD, LONG_MS),
    ("a node rebooted", "reboot:node=head,step=cure,pass=1", in_third_pass, Node.HEAD, SHORT_MS),
    ("two masters", "second-master:step=pass,pass=1", in_second_pass, Node.HEAD, LONG_MS),
    ("adapter unplugged", "unplugged:step=pass,pass=1", in_second_pass, Node.HEAD, LONG_MS),
    ("bus-off", "bus-off:step=pass,pass=1", in_second_pass, Node.HEAD, LONG_MS),
    ("bus-off of a node", "bus-off:node=head,step=pass,pass=1,frames=40", in_second_pass, Node.HEAD, LONG_MS),
    ("a node's queue holds three frames", "short-queue:node=head", in_transfer, Node.HEAD, SHORT_MS),
    ("frames of one id sent out of order", "transmit-order:id=0x647,nth=3", in_scan, Node.PROFILER, SHORT_MS),
    ("an erasure of 200 ms", "slow-erase:node=head,step=pass,pass=1", in_second_pass, Node.HEAD, SHORT_MS),
    (
        "an erasure longer than the watchdog",
        "slow-erase:node=head,step=pass,frames=60",
        in_second_pass,
        Node.HEAD,
        LONG_MS,
    ),
    ("records that cannot be read", f"{UNREADABLE} reboot:{SECOND}", with_records_lost, Node.HEAD, LONG_MS),
    ("a map short each time", "short-map:count=1000000", in_scan, Node.PROFILER, SHORT_MS),
    ("another pattern than the journal's", "", with_another_pattern, Node.HEAD, SHORT_MS),
    ("a stop request", "", with_a_stop_request, Node.HEAD, SHORT_MS),
    ("a disk of the nodes full", "broken:part=storage-full,step=pass,pass=1", in_second_pass, Node.HEAD, SHORT_MS),
)
"""Name, fault, what is printed, whose record is shown, duration of a pass [ms]."""


def rows() -> Iterator[Row]:
    """The rows, each on an emulator of its own. A frame that an adapter refuses (ENOBUFS) is no matter of the nodes."""
    for name, fault, print_layer, node, pass_ms in FAILURES:
        with faulty(*fault.split(), pass_ms=pass_ms) as run:
            yield name, f"`{fault}`" if fault else "", _outcome(run, print_layer), *_record(run, node)
    with faulty() as run:
        run.print_layer(2)
        with looked_at(run) as new:
            yield "the master restarted", "", "done", *_record(new, Node.HEAD)


def _outcome(run: FaultRun, print_layer: Callable[[FaultRun], None]) -> str:
    try:
        print_layer(run)
    except HardwareError as error:
        if isinstance(error, BusDisconnected):
            wait_until(lambda: run.rig.keep_alive() is None and not run.rig.supervision.bus.disconnected)
        run.rig.wait_for(Node, LIMIT_S)
        return type(error).__name__
    return "done"


def _record(run: FaultRun, node: Node) -> tuple[str, str]:
    link = run.rig.link(node)
    state, newest = link.state(), link.journal()[0]
    return state.state.name + (f", {state.cause.name}" if state.cause else ""), _name(newest)


def _name(record: JournalRecord) -> str:
    step = f" {record.step.name.lower()} {record.key.pass_ + 1}" if record.step in (Step.PASS, Step.CURE) else ""
    return record.kind.name + (step or (f" {record.step.name.lower()}" if record.step else ""))

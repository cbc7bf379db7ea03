"""Commands of a person to a bench: clear, home, purge, a dry run; stop and release. Each yields its output.

A stop request is sent without MasterAlive, so that a print on the bus meets the request and no second master. Every
node takes its de-energised state, and stays in it until the request is released. No emergency stop.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, closing

import numpy as np

from inkloop.component import Job
from inkloop_hardware.bus.adapter import Adapter, data_frame
from inkloop_hardware.bus.heartbeat import Supervised
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.profiler import check_seen
from inkloop_hardware.devices.readiness import MARGIN_S, NotReady, blocked, clear, make_ready, set_dry_run
from inkloop_hardware.devices.readiness import home as find_zero
from inkloop_hardware.errors import FrameError, HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Flags
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, Source, State, StopRequest, unpack
from inkloop_hardware.protocol.services import ClearOption, Key, Routine
from inkloop_hardware.protocol.transfer_bytes import read_map

NODES = tuple(Node)


def clear_all(rig: Rig, *, give_up: bool = False) -> Iterator[str]:
    """Release all nodes, as a person who has checked the bench; give_up: the open layer is not to be finished."""
    rig.wait_for(NODES)
    option = ClearOption.OPERATOR | (ClearOption.ABANDON if give_up else ClearOption(0))
    for node in NODES:
        state = rig.link(node).state()
        if state.flags & Flags.JOURNAL_UNREADABLE and not give_up and (reason := blocked(node, state)):
            raise NotReady(reason)
        clear(rig, node, int(option))
        yield f"{node.lower()}: cleared" + (", its open layer is given up" if give_up else "")


def home(rig: Rig) -> Iterator[str]:
    """Have the stage find its zero."""
    rig.wait_for((Node.STAGE,))
    clear(rig, Node.STAGE)
    find_zero(rig)
    yield "stage: at its zero"


def purge(rig: Rig) -> Iterator[str]:
    """Purge the head."""
    rig.wait_for((Node.HEAD,))
    clear(rig, Node.HEAD)
    head = rig.link(Node.HEAD)
    head.routine(Routine.PURGE, Key(rig.job, 0), limit_s=head.limits().motion + MARGIN_S)
    yield "head: purged"


def dry_run(rig: Rig, job: Job, *, cure_ms: int) -> Iterator[str]:
    """One whole layer without jet and lamp: transfer, every move, pass and cure, the scan and its map."""
    limits = make_ready(rig, NODES)
    with ExitStack() as stack:
        for node in NODES:
            set_dry_run(rig, node, on=True)
            stack.callback(set_dry_run, rig, node, on=False)
        steps = LayerSteps(rig, job, limits, cure_ms=cure_ms, dry=True)
        pattern = job.mask.astype(np.int32)
        steps.print_layer(1, pattern)
        passes = f"{job.passes} passes" if job.passes > 1 else "one pass"
        yield f"a layer of {pattern.sum()} droplets in {passes}: all steps went through, nothing was jetted or lit"
        _, valid = read_map(steps.scan(1), job.nx, job.ny)
        yield f"its scan: {job.nx} x {job.ny} cells, {valid.mean():.0%} of them valid"
        check_seen(valid, rig, "the scan")


FRAMES_MIN = 6
"""A node is released by two intact frames in a row, and stopped by one; the others may be lost."""
CONFIRM_SILENCES = 7.0
"""Silences after which a run takes a node for lost, in which a node that lives has sent twenty statuses."""


def request_stop(settings: BusSettings) -> Iterator[str]:
    """Send the request until every node has confirmed it, and yield a line for each.

    HardwareError names the nodes that did not confirm; the request was sent to them all the same. BusError if the
    adapter cannot be used.
    """
    confirmed: dict[Node, NodeStatus] = {}
    within_s = CONFIRM_SILENCES * settings.silence_s
    with closing(Adapter(settings)) as adapter:
        for status in _sent(adapter, active=True, within_s=within_s):
            if status.node not in confirmed and _is_stopped(status):
                confirmed[status.node] = status
                yield f"{status.node.lower()}: {status.state.name} because of {status.fault.name}"
            if len(confirmed) == len(Node):
                break
    missing = [node.lower() for node in Node if node not in confirmed]
    if missing:
        raise HardwareError(
            f"{settings}: {', '.join(missing)} did not confirm the stop request within {within_s:.1f} s. Use the "
            "hard-wired stop, then check power and cables"
        )
    yield "stopped; look at the bench, then `inkloop bench release SCENARIO` and `clear`"


def release_stop(settings: BusSettings) -> Iterator[str]:
    """Release the request. The nodes stay off until a person clears them. BusError if the adapter cannot be used."""
    with closing(Adapter(settings)) as adapter:
        for _ in _sent(adapter, active=False, within_s=0.0):
            pass
    yield "the stop request is released; the nodes stay off until `inkloop bench clear SCENARIO`"


def _sent(adapter: Adapter, *, active: bool, within_s: float) -> Iterator[NodeStatus]:
    """Send the request in its cycle, `FRAMES_MIN` times and for `within_s` at least, and yield the intact statuses that
    arrive meanwhile."""
    codec = Codec()
    sender, cycle = Supervised(codec), codec.cycle_time(StopRequest.message) or 0.05
    began = adapter.now()
    for sent in range(1, 1 + max(FRAMES_MIN, math.ceil(within_s / cycle))):
        adapter.send(sender.frame(StopRequest(active, Source.OPERATOR)))
        while (left := began + sent * cycle - adapter.now()) > 0:
            yield from _statuses(adapter, codec, left)


def _statuses(adapter: Adapter, codec: Codec, wait_s: float) -> Iterator[NodeStatus]:
    for message in adapter.receive(wait_s):
        frame = data_frame(message)
        if frame is None:
            continue
        try:
            reading = codec.decode(frame)
            record = unpack(codec, reading) if reading.intact else None
        except FrameError:  # of another protocol: no confirmation
            continue
        if isinstance(record, NodeStatus):
            yield record


def _is_stopped(status: NodeStatus) -> bool:
    return status.state is State.FAULT or (status.state is State.SAFE and status.fault is Fault.STOP_REQUEST)

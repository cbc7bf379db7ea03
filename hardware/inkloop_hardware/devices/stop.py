"""A person's stop request: every node takes its de-energised state, and stays in it until the request is released.

It is sent without MasterAlive, so that a print on the bus meets the request and no second master. No emergency stop.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import closing

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.frames import data_frame
from inkloop_hardware.bus.heartbeat import Supervised
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import FrameError, HardwareError
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import NodeStatus, StopRequest, unpack
from inkloop_hardware.protocol.vocabulary import Fault, Node, Source, State

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
    began, sent, least = time.monotonic(), 0, max(FRAMES_MIN, math.ceil(within_s / cycle))
    while sent < least or time.monotonic() < began + within_s:
        adapter.send(sender.frame(StopRequest(active, Source.OPERATOR)))
        sent += 1
        while (left := began + sent * cycle - time.monotonic()) > 0:
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

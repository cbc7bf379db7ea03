"""The stop request of a person, on a bus without a kernel: its frames, and the nodes that confirmed it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from threading import Event, Thread

import can
import pytest

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.commands import release_stop, request_stop
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.node_watch import E2eMonitor, Verdict
from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, Source, State, StopRequest, pack, unpack

CODEC = Codec()
PRINTING = (State.PRINTING, Fault.NONE)


def status(node: Node, state: State, fault: Fault, counter: int) -> can.Message:
    record = NodeStatus(node, False, False, True, True, state, 0, fault, 0, 1, 0, 1)
    frame = pack(CODEC, record, counter % COUNTERS)
    return can.Message(arbitration_id=frame.arbitration_id, data=frame.data, is_extended_id=False)


@contextmanager
def bus(channel: str, *deaf: Node, stays: tuple[State, Fault] = PRINTING) -> Iterator[list[Frame]]:
    """Nodes that go SAFE with the first stop request, but those that are deaf, which stay as they are.

    Yields the frames that they received.
    """
    received, over, stopped = list[Frame](), Event(), False
    with ExitStack() as stack:
        nodes = stack.enter_context(can.Bus(interface="virtual", channel=channel))

        def take() -> None:
            nonlocal stopped
            while (message := nodes.recv(0.005)) is not None:
                frame = Frame(message.arbitration_id, bytes(message.data))
                received.append(frame)
                stopped |= unpack(CODEC, CODEC.decode(frame)) == StopRequest(True, Source.OPERATOR)

        def answer() -> None:
            counter = 0
            while not over.is_set():
                take()
                counter += 1
                nodes.send(can.Message(arbitration_id=0x101, data=bytes(7), is_extended_id=False))  # of other firmware
                for node in Node:
                    safe = stopped and node not in deaf
                    found = (State.SAFE, Fault.STOP_REQUEST) if safe else stays
                    nodes.send(status(node, *found, counter))
            take()

        thread = Thread(target=answer)
        thread.start()
        try:
            yield received
        finally:
            over.set()
            thread.join()


def requests(frames: list[Frame]) -> list[bool]:
    """Whether each is active; all are whole stop requests in a row of an operator, and nothing else was sent."""
    monitor, found = E2eMonitor(), []
    for frame in frames:
        reading = CODEC.decode(frame)
        assert monitor.take(reading.intact, reading.counter or 0) in (Verdict.FIRST, Verdict.GOOD)
        record = unpack(CODEC, reading)
        assert isinstance(record, StopRequest), "no MasterAlive: a run must not meet a second master"
        assert record.source is Source.OPERATOR
        found.append(record.active)
    return found


def test_stop_is_sent_until_every_node_confirms_or_is_in_fault() -> None:
    """Such a node is de-energised, and keeps the cause that it had."""
    with bus("stop", Node.PROFILER, stays=(State.FAULT, Fault.LAMP_TIME)) as received:
        lines = list(request_stop(BusSettings("virtual", "stop")))
    stopped = {f"{node.lower()}: SAFE because of STOP_REQUEST" for node in list(Node)[:3]}
    assert stopped | {"profiler: FAULT because of LAMP_TIME"} <= set(lines)
    assert set(requests(received)) == {True}


@pytest.mark.parametrize("stays", [PRINTING, (State.SAFE, Fault.MASTER_LOST)], ids=["printing", "other cause"])
def test_node_that_does_not_confirm_in_the_time_of_the_settings_is_an_error_that_names_it(
    stays: tuple[State, Fault],
) -> None:
    lines: list[str] = []
    words = r": cure did not confirm the stop request within 0\.7 s.*hard-wired"
    with bus("deaf", Node.CURE, stays=stays) as received, pytest.raises(HardwareError, match=words):
        lines.extend(request_stop(BusSettings("virtual", "deaf", silence_s=0.1)))
    assert len(requests(received)) >= 14, "in its cycle of 50 ms for all of 0.7 s"


def test_release_sends_more_frames_than_a_node_needs() -> None:
    with bus("release") as received:
        (line,) = release_stop(BusSettings("virtual", "release"))
    assert requests(received) == [False] * 6
    assert "clear" in line

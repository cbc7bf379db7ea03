"""The firmware's side of the serial line protocol, against python-can's slcan interface on the other side."""

from __future__ import annotations

from collections.abc import Iterator

import can
import pytest
from can.interfaces.slcan import slcanBus
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from support.benches.wire_library import SlcanEnd, SlcanFrame


@pytest.fixture
def bus() -> Iterator[slcanBus]:
    """python-can's end; what it sends, and what it is to receive, are bytes of its looped port."""
    with slcanBus("loop://", sleep_after_open=0, bitrate=500_000) as bus:
        yield bus


def sent(bus: slcanBus) -> bytes:
    """Bytes that the bus has written since, taken off the loop; a read ends after its time, even with bytes left."""
    port, found = bus.serialPortOrig, b""
    while port.in_waiting:
        found += port.read(port.in_waiting)
    return found


@st.composite
def frames(draw: st.DrawFn) -> SlcanFrame:
    extended, remote = draw(st.booleans()), draw(st.booleans())
    arbitration_id = draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF))
    length = draw(st.integers(0, 8))
    data = b"" if remote else draw(st.binary(min_size=length, max_size=length))
    return SlcanFrame(arbitration_id, extended, remote, length, data)


def as_message(frame: SlcanFrame) -> can.Message:
    return can.Message(
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        dlc=frame.length,
        data=None if frame.remote else frame.data,
    )


MALFORMED = (
    *(b"t", b"t02", b"t0209", b"t02011", b"t020111 ", b"t8000", b"T200000000", b"tG200", b"r02081122334455667788"),
    *(b"x", b"z", b"Q", b"O1", b"S", b"S9", b"s12", b"Z2", b"\xff\x00", b"t" * 40, b"t020\n0"),
    *(b"d0201AA", b"D000000201AA", b"b0201AA"),  # CAN FD
)
COMMANDS = {
    b"": b"\r",
    b"V": b"V0100\r",
    b"\nV": b"V0100\r",
    b"N": b"N0001\r",
    b"F": b"F00\r",
    b"Z0": b"\r",
    b"Z1": b"\a",
    b"O": b"\r",
    b"S6": b"\a",
    b"C\rS6": b"\r\r",
    b"C\rs031C": b"\r\r",
}
SAME_BUS = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def test_opening_by_python_can_opens(bus: slcanBus) -> None:
    end = SlcanEnd(opened=False)
    frames, answers = end.take(sent(bus))
    assert frames == []
    assert b"\a" not in answers
    end.take(b"t0200\r")
    assert list(end.counts) == [1, 0, 0]


@SAME_BUS
@given(frame=frames())
def test_lines_of_python_can_are_read(bus: slcanBus, frame: SlcanFrame) -> None:
    sent(bus)
    bus.send(as_message(frame))
    found, answers = SlcanEnd().take(sent(bus))
    assert found == [frame]
    assert answers == (b"Z\r" if frame.extended else b"z\r")


@SAME_BUS
@given(frame=frames())
def test_our_lines_are_what_python_can_would_write_and_read(bus: slcanBus, frame: SlcanFrame) -> None:
    sent(bus)
    bus.send(as_message(frame))
    line = SlcanEnd().write(frame)
    assert line == sent(bus)
    bus.serialPortOrig.write(line)
    message = bus.recv(timeout=1)
    assert message is not None
    assert message.equals(as_message(frame), timestamp_delta=None, check_channel=False, check_direction=False)


@pytest.mark.parametrize("line", MALFORMED)
def test_malformed_lines_are_answered_with_bel_counted_and_forgotten(line: bytes) -> None:
    end = SlcanEnd()
    assert end.take(line + b"\r") == ([], b"\a")
    assert list(end.counts) == [0, 1, 0]
    assert end.take(b"t0201AB\r") == ([SlcanFrame(0x20, False, False, 1, b"\xab")], b"z\r")


def test_hexadecimal_digits_may_be_small() -> None:
    assert SlcanEnd().take(b"t7fe2abcd\r") == ([SlcanFrame(0x7FE, False, False, 2, b"\xab\xcd")], b"z\r")


def test_frames_are_refused_while_closed_or_listening() -> None:
    end = SlcanEnd(opened=False)
    assert end.take(b"t0200\r") == ([], b"\a")
    assert end.take(b"L\rt0200\r") == ([], b"\r\a")
    assert end.take(b"C\rO\r") == ([], b"\r\r")
    assert list(end.counts) == [0, 0, 2]
    assert end.take(b"t0200\r")[1] == b"z\r"
    assert end.take(b"L\rO\rt0200\r")[1] == b"\r\rz\r", "it does not only listen any more"


@pytest.mark.parametrize(("line", "answer"), list(COMMANDS.items()))
def test_commands_are_answered(line: bytes, answer: bytes) -> None:
    assert SlcanEnd().take(line + b"\r") == ([], answer)


def test_python_can_reads_the_version(bus: slcanBus) -> None:
    sent(bus)
    _, answer = SlcanEnd().take(b"V\r")
    bus.serialPortOrig.write(answer)
    line = bus._read(1)
    assert line is not None
    assert (int(line[1:3]), int(line[3:5])) == (1, 0)

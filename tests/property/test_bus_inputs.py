"""For any input from an adapter or a node the master gets valid values or an error message, in bounded time."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from struct import pack
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from e2e import p01
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from udsoncan import MemoryLocation

from inkloop_hardware.bus.slcan_bus import BulkSlcanBus
from inkloop_hardware.errors import FrameError, HardwareError
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.node_watch import NodeWatch
from inkloop_hardware.mapped.mapped_peer import Peer
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import KINDS, Node, NodeFault, NodeStatus, unpack
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.transfer_bytes import map_size, read_map
from support.benches.wire_library import IsotpEnd
from support.examples import examples
from support.verdicts import Verdicts

CODEC = Codec()
COUNTED = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=examples(40))
REQUEST, ANSWER = 0x640, 0x641
PATIENCE_S, LOOKS_MAX = 300.0, 20_000
"""Of the injected clock, and looks at the wire: beyond them a call hangs."""
TEXTS = [b"t", b"T", b"r", b"R", b"z\r", b"Z\r", b"\r", b"\a", b"7FF", b"1FFFFFFF", b"8", b"0102030405060708", b"0\r"]


def bulk_bus() -> BulkSlcanBus:
    """Without a port: `take` is what is looked at."""
    bus = BulkSlcanBus.__new__(BulkSlcanBus)
    bus._is_shutdown = True
    bus.begin_reading()
    return bus


def taken(pieces: Sequence[bytes]) -> tuple[list[Any], int]:
    """Frames of a text that comes in pieces, and how many lines were malformed."""
    bus = bulk_bus()
    for piece in pieces:
        bus.take(piece)
    frames = [
        (found.arbitration_id, found.is_extended_id, found.is_remote_frame, found.dlc, bytes(found.data))
        for found in bus.waiting
    ]
    return frames, bus.malformed


@settings(max_examples=examples(300))
@given(st.lists(st.sampled_from(TEXTS) | st.binary(max_size=40), max_size=30).map(b"".join), st.data())
@example(b"tFFF0\rTFFFFFFFF0\r", None)
def test_lines_of_an_adapter_give_frames_of_the_standard_however_they_are_cut(text: bytes, data: Any) -> None:
    frames, malformed = taken([text])
    for arbitration_id, extended, remote, length, content in frames:
        assert arbitration_id < 1 << (29 if extended else 11)
        assert length <= 8
        assert len(content) == (0 if remote else length)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(text)), max_size=8))) if data else range(len(text))
    pieces = [text[at:end] for at, end in zip([0, *cuts], [*cuts, len(text)], strict=True)]
    assert taken(pieces) == (frames, malformed)


@settings(max_examples=examples(300))
@given(
    st.sampled_from(sorted(CODEC.message(name).frame_id for name in KINDS)) | st.integers(0, 0x7FF),
    st.binary(min_size=8, max_size=8) | st.binary(max_size=8),
    st.none() | st.integers(0, 14),
)
def test_frame_of_any_content_is_read_or_refused_with_a_message(
    identifier: int, content: bytes, counter: int | None
) -> None:
    frame = Frame(identifier, protected(identifier, content, counter))
    try:
        reading = CODEC.decode(frame)
        record = unpack(CODEC, reading) if reading.intact else None
    except FrameError:
        return
    watch = NodeWatch(record.node if isinstance(record, NodeStatus | NodeFault) else Node.HEAD)
    if isinstance(record, NodeFault):
        watch.take_fault(record)
    elif isinstance(record, NodeStatus) or record is None:
        watch.take_status(0.0, record, reading.counter or 0)
    assert watch.trouble(1.0)


def protected(identifier: int, content: bytes, counter: int | None) -> bytes:
    """With the right check byte for a supervised message, if there is a counter."""
    names = [name for name in KINDS if CODEC.message(name).frame_id == identifier]
    data_id = CODEC.data_id(names[0]) if names else None
    if counter is None or data_id is None or len(content) < 8:
        return content
    data = bytearray(content)
    data[1] = data[1] & 0xF0 | counter
    p01.e2e_p01_protect(data, data_id, increment_counter=False)
    return bytes(data)


class ReplyingWire:
    """A node that answers with what it is given, each message to one request, the last one for ever."""

    def __init__(self, replies: Sequence[bytes | Frame]) -> None:
        self.replies = deque(replies)
        self.clock = 0.0
        self.looks = 0
        self.end = IsotpEnd(8, receive=REQUEST, send=ANSWER)
        self.waiting: deque[bytes] = deque()

    def begin(self) -> None:
        pass

    def check(self) -> None:
        pass

    def now(self) -> float:
        return self.clock

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.end.take(frame, round(1e3 * self.clock))
            self._turn()

    def receive(self, wait_s: float) -> bytes | None:
        self.looks += 1
        assert self.looks < LOOKS_MAX, "it hangs"
        assert self.clock < PATIENCE_S, "it waits too long"
        self._turn()
        if not self.waiting:
            self.clock += wait_s
            self.end.tick(round(1e3 * self.clock))
            self._turn()
        return self.waiting.popleft() if self.waiting else None

    def _turn(self) -> None:
        now = round(1e3 * self.clock)
        if not self.end.state.is_sending:
            request = self.end.receive()
            reply: bytes | Frame = b""
            if request and self.replies:
                reply = self.replies.popleft() if len(self.replies) > 1 else self.replies[0]
            if isinstance(reply, Frame):
                self.waiting.append(reply.data)
            elif reply:
                self.end.send(fitting(request, reply))
        while (frame := self.end.next(now)) is not None:
            self.waiting.append(frame.data)


def fitting(request: bytes, reply: bytes) -> bytes:
    """The answer with its head: 0 in its first byte stands for a positive answer of this request, 1 for a refusal, 2
    for "still busy"; anything else is sent as it is.
    """
    service = request[0]
    if reply[0] == 0:
        echoes = {
            0x22: request[1:3],
            0x31: request[1:4] + reply[1:2].ljust(1, b"\0") + request[4:12],
            0x36: request[1:2],
        }
        return bytes([service + 0x40]) + echoes.get(service, b"") + reply[1:]
    if reply[0] == 1:
        return bytes([0x7F, service]) + reply[1:]
    return bytes([0x7F, service, 0x78]) if reply[0] == 2 else reply


@pytest.fixture
def verdicts() -> Iterator[Verdicts]:
    """Right answers are taken, whole or with a byte that does not matter, some others are refused."""
    found = Verdicts()
    yield found
    found.check(1 / 20)


KEY = Key(7, 1)
CALLS: dict[str, Callable[[Link], object]] = {
    "state": Link.state,
    "times": Link.times,
    "limits": Link.limits,
    "map size": Link.map_size,
    "journal": Link.journal,
    "version": Link.version,
    "routine": lambda link: link.routine(Routine.PASS, KEY, b"\0", limit_s=20.0),
    "ask": lambda link: link.ask(Routine.PASS, KEY),
    "download": lambda link: link.download(1, bytes(300)),
    "upload": lambda link: link.upload(1),
}
BLOCKS, BLOB, MAP = b"\0" + pack(">BH", 0x20, 4095), bytes(300), bytes(map_size(3, 5))
RIGHT: dict[str, list[bytes]] = {
    "state": [bytes(33)],
    "times": [bytes(29)],
    "limits": [bytes(31)],
    "map size": [b"\0" + pack(">IHH", len(MAP), 3, 5)],
    "journal": [b"\0"],
    "version": [b"\0inkloop 0.1.0"],
    "routine": [b"\0\0"],
    "ask": [b"\0\1"],
    "download": [BLOCKS, b"\0", b"\0" + pack(">I", crc32(BLOB))],
    "upload": [b"\0" + pack(">IHH", len(MAP), 3, 5), BLOCKS, b"\0" + MAP, b"\0" + pack(">I", crc32(MAP))],
}
"""Answers of a node that works."""
HEADS = st.sampled_from([b"\0", b"\0", b"\0", b"\1", b"\2", b""])
REPLIES = st.builds(bytes.__add__, HEADS, st.binary(min_size=1, max_size=60))
LENGTHS = st.sampled_from([pack(">BH", 0x20, most) for most in (0, 1, 2, 3, 64, 4095, 0xFFFF)]).map(b"\0".__add__)
SIZES = st.sampled_from([pack(">IHH", size, 3, 5) for size in (0, 44, 45, 0xFFFFFFFF)]).map(b"\0".__add__)
FRAMES = st.binary(max_size=8).map(lambda data: Frame(ANSWER, data))
FLAWS = st.tuples(st.integers(0, 3), st.integers(0, 60))
"""Number of an answer, and of the byte of it that is not as it should be, where there is one."""


def flawed(answers: list[bytes], flaw: tuple[int, int]) -> list[bytes]:
    number, at = flaw
    return [
        answer[:at] + bytes([answer[at] ^ 0x55]) + answer[at + 1 :] if k == number and at < len(answer) else answer
        for k, answer in enumerate(answers)
    ]


@pytest.mark.compiled
@pytest.mark.parametrize("name", CALLS)
@COUNTED
@given(replies=st.lists(REPLIES | LENGTHS | SIZES | FRAMES, min_size=1, max_size=6) | FLAWS)
@example(replies=[b"\2"])
@example(replies=[b"\0"])
@example(replies=[b"\0\0\0"])
@example(replies=[pack(">BIHH", 0, 44, 3, 5), b"\0\x20\x0f\xff", b"\0"])
@example(replies=[b"\0\x20\x00\x02", b"\0"])
@example(replies=[b"\x7e\x05"])
@example(replies=[b"\x7f"])
@example(replies=(0, 60))  # past the ends of the answers, which are all right
@example(replies=(1, 60))
@example(replies=(2, 60))
def test_answers_of_any_bytes_to_a_link_end_with_a_message(
    name: str, replies: list[bytes | Frame] | tuple[int, int], verdicts: Verdicts
) -> None:
    wire = ReplyingWire(flawed(RIGHT[name], replies) if isinstance(replies, tuple) else replies)
    with verdicts.count(HardwareError):
        CALLS[name](Link(Node.HEAD, CODEC, wire, "a wire"))


PEER_CALLS: dict[str, Callable[[Peer], object]] = {
    "read": lambda peer: peer.read(0x0100),
    "routine": lambda peer: peer.routine(0x0200, b"\1", 20.0),
    "download": lambda peer: peer.download(MemoryLocation(1, 300, 32, 32), bytes(300), True),
    "upload": lambda peer: peer.upload(MemoryLocation(1, 45, 32, 32), 45, True),
}
PEER_RIGHT: dict[str, list[bytes]] = {
    "read": [b"\0\1\2"],
    "routine": [b"\0\0"],
    "download": [BLOCKS, b"\0"],
    "upload": [BLOCKS, b"\0" + bytes(45), b"\0" + pack(">I", crc32(bytes(45)))],
}


@pytest.mark.compiled
@pytest.mark.parametrize("name", PEER_CALLS)
@COUNTED
@given(replies=st.lists(REPLIES | LENGTHS | FRAMES, min_size=1, max_size=6) | FLAWS)
@example(replies=[b"\2"])
@example(replies=[b"\0"])
@example(replies=(0, 60))  # past the ends of the answers, which are all right
@example(replies=(1, 60))
@example(replies=(2, 60))
def test_answers_of_any_bytes_to_a_peer_end_with_a_message(
    name: str, replies: list[bytes | Frame] | tuple[int, int], verdicts: Verdicts
) -> None:
    wire = ReplyingWire(flawed(PEER_RIGHT[name], replies) if isinstance(replies, tuple) else replies)
    with verdicts.count(HardwareError):
        PEER_CALLS[name](Peer("head", wire, REQUEST, ANSWER, 1.0))


@settings(max_examples=examples(300))
@given(
    st.sampled_from([(1, 1), (3, 5), (8, 1)]),
    st.builds(
        pack,
        st.just(">BBHHHi"),
        st.sampled_from([0, 1, 1, 1]),
        st.just(0),
        st.sampled_from([1, 3, 8]),
        st.sampled_from([1, 5]),
        st.integers(0, 0xFFFF),
        st.integers(-(2**31), 2**31 - 1),
    )
    | st.binary(max_size=20),
    st.binary(max_size=40) | st.just(b"\x80\x00" * 15 + b"\xff\xff"),
)
def test_bytes_of_a_map_are_finite_heights_or_refused_with_a_message(
    shape: tuple[int, int], head: bytes, rest: bytes
) -> None:
    try:
        heights, valid = read_map(head + rest, *shape)
    except FrameError:
        return
    assert len(head + rest) == map_size(*shape)
    assert heights.shape == valid.shape == shape
    assert np.isfinite(heights).all()
    assert not heights[~valid].any()

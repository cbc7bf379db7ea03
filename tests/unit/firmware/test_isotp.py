"""The firmware's ISO-TP: against can-isotp both ways, and what it does with what goes wrong on the bus."""

from __future__ import annotations

import subprocess
from collections import deque

import isotp
import pytest

from inkloop_hardware.protocol.codec import Frame
from support.benches.wire_library import ANSWER_ID, CAN, REQUEST_ID, WARNINGS, IsotpEnd
from support.compiled import program
from support.places import C_SOURCES

SIZES = [*range(1, 30), 61, 62, 63, 118, 119, 120, 509, 1250, 4000, 4094, 4095]
PADDED = 8


def payload(length: int) -> bytes:
    return bytes((7 * i + i // 256 + length) % 256 for i in range(length))


class Peer:
    """can-isotp without threads, as the master uses it."""

    def __init__(self, block_size: int = 0, longest: int = 4095) -> None:
        self.inbox: deque[Frame] = deque()
        self.outbox: deque[Frame] = deque()
        self.errors: list[Exception] = []
        address = isotp.Address(isotp.AddressingMode.Normal_11bits, rxid=ANSWER_ID, txid=REQUEST_ID)
        parameters = {"blocksize": block_size, "stmin": 0, "tx_padding": 0x55, "max_frame_size": longest}
        self.layer = isotp.TransportLayerLogic(self._receive, self._send, address, self.errors.append, parameters)

    def _receive(self, timeout: float) -> isotp.CanMessage | None:
        if not self.inbox:
            return None
        frame = self.inbox.popleft()
        return isotp.CanMessage(arbitration_id=frame.arbitration_id, data=frame.data, dlc=len(frame.data))

    def _send(self, message: isotp.CanMessage) -> None:
        self.outbox.append(Frame(message.arbitration_id, bytes(message.data)))


def talk(node: IsotpEnd, peer: Peer, turns: int = 2000) -> None:
    """Lets both continue until neither has anything to send."""
    for now in range(turns):
        peer.layer.process()
        quiet = not peer.outbox
        while peer.outbox:
            assert node.take(peer.outbox.popleft(), now)
        while (frame := node.next(now)) is not None:
            assert (frame.arbitration_id, len(frame.data)) == (ANSWER_ID, PADDED)
            peer.inbox.append(frame)
            quiet = False
        if quiet and not peer.inbox and not node.state.is_sending and not peer.layer.transmitting():
            return
    raise AssertionError("the two still talk")


@pytest.mark.parametrize("block_size", [0, 8])
@pytest.mark.parametrize("size", SIZES)
def test_messages_of_can_isotp_arrive(size: int, block_size: int) -> None:
    node, peer = IsotpEnd(block_size), Peer()
    peer.layer.send(payload(size))
    talk(node, peer)
    assert node.receive() == payload(size)
    assert (node.state.received, node.state.malformed, peer.errors) == ("done", 0, [])


@pytest.mark.parametrize("block_size", [0, 8])
@pytest.mark.parametrize("size", SIZES)
def test_messages_reach_can_isotp(size: int, block_size: int) -> None:
    node, peer = IsotpEnd(), Peer(block_size)
    assert node.send(payload(size))
    talk(node, peer)
    assert peer.layer.recv() == payload(size)
    assert (node.state.sent, node.state.unexpected, peer.errors) == ("done", 0, [])


def test_overflow_of_can_isotp_ends_our_message_at_once() -> None:
    node, peer = IsotpEnd(), Peer(longest=100)
    assert node.send(payload(101))
    talk(node, peer)
    assert (node.state.sent, peer.layer.recv()) == ("overflow", None)
    assert node.send(payload(100))
    talk(node, peer)
    assert (node.state.sent, peer.layer.recv()) == ("done", payload(100))


def test_both_ways_at_once_do_not_disturb_each_other() -> None:
    node, peer = IsotpEnd(8), Peer(8)
    peer.layer.send(payload(900))
    assert node.send(payload(700))
    talk(node, peer)
    assert (node.receive(), peer.layer.recv()) == (payload(900), payload(700))


def segments(message: bytes) -> list[Frame]:
    """First frame and consecutive frames of a message of more than 7 bytes."""
    first = bytes([0x10 | len(message) >> 8, len(message) & 0xFF]) + message[:6]
    rest = [message[at : at + 7] for at in range(6, len(message), 7)]
    return [
        Frame(REQUEST_ID, first),
        *(Frame(REQUEST_ID, bytes([0x20 | (i + 1) % 16]) + part.ljust(7, b"\xcc")) for i, part in enumerate(rest)),
    ]


def test_a_lost_doubled_or_swapped_frame_ends_the_message_and_the_next_one_arrives() -> None:
    message = payload(100)
    whole = segments(message)
    lost = whole[:5] + whole[6:]
    doubled = whole[:6] + whole[5:]
    swapped = [*whole[:5], whole[6], whole[5], *whole[7:]]
    for damaged in (lost, doubled, swapped):
        node = IsotpEnd()
        for frame in damaged:
            node.take(frame, 0)
        assert (node.receive(), node.state.received) == (b"", "sequence")
        assert node.state.unexpected > 0
        for frame in whole:
            node.take(frame, 1)
        assert (node.receive(), node.state.received) == (message, "done")


def test_sender_that_waited_for_no_flow_control_gets_none_after_the_end() -> None:
    whole = segments(payload(100))
    for last in (whole[4], whole[3]):
        node = IsotpEnd(block_size=2)
        for frame in (*whole[:3], last, last):
            node.take(frame, 0)
        assert (node.state.received, node.next(0)) == ("sequence", None)


def test_sender_has_a_second_from_each_frame_and_flow_control_even_where_the_clock_wraps() -> None:
    """The bus may be too busy to send the flow control: no time runs before."""
    start = 2**32 - 500
    message, node = payload(100), IsotpEnd()
    first, *rest = segments(message)
    node.take(first, start - 1500)
    node.tick(start)
    assert node.next(start) == Frame(ANSWER_ID, bytes.fromhex("300000cccccccccc"))
    for number, frame in enumerate(rest[:-1], start=1):
        node.take(frame, (start + 900 * number) % 2**32)
    last = start + 900 * (len(rest) - 1)
    node.tick((last + 999) % 2**32)
    assert node.state.received == "none"
    node.tick((last + 1000) % 2**32)
    assert (node.state.received, node.receive()) == ("timeout", b"")
    assert not node.take(Frame(0x123, b"\0"), 0)


def test_separation_is_that_of_two_frames_of_one_block() -> None:
    """Two frames a block, 20 ms between them; the first one of a block follows its flow control at once."""
    node, go = IsotpEnd(), Frame(REQUEST_ID, bytes.fromhex("300214"))
    assert node.send(payload(60))
    assert node.next(0) is not None
    for began in (5, 27):
        node.take(go, began)
        assert node.next(began) is not None
        assert node.next(began + 20) is None
        assert node.next(began + 21) is not None
        assert node.next(began + 22) is None, "the block is over"


@pytest.mark.parametrize(
    ("on_wire", "gap"),
    [(0, 0), (1, 1), (127, 127), (0x80, 127), (0xF0, 127), (0xF1, 1), (0xF9, 1), (0xFA, 127), (0xFF, 127)],
)
def test_separation_of_less_than_a_millisecond_is_one_and_a_reserved_one_the_longest(on_wire: int, gap: int) -> None:
    node = IsotpEnd()
    assert node.send(payload(30))
    assert node.next(0) is not None
    node.take(Frame(REQUEST_ID, bytes([0x30, 0, on_wire])), 1)
    assert node.next(1) is not None
    assert (node.next(1 + gap) is None) is (gap > 0)
    assert node.next(2 + gap) is not None


@pytest.mark.parametrize("separation", [0, 7])
def test_flow_control_asks_for_the_blocks_and_gaps_of_its_node(separation: int) -> None:
    node = IsotpEnd(5, separation)
    node.take(segments(payload(100))[0], 0)
    flow = node.next(0)
    assert flow is not None
    assert flow.data[:3] == bytes([0x30, 5, separation])


def test_missing_flow_control_is_given_up_after_a_second_and_sending_is_free_again() -> None:
    node = IsotpEnd()
    assert node.send(payload(100))
    assert node.next(10) is not None
    assert node.next(1000) is None
    node.tick(1009)
    assert node.state.is_sending
    assert not node.send(b"busy")
    node.tick(1010)
    assert (node.state.sent, node.state.is_sending) == ("timeout", False)
    node.take(Frame(REQUEST_ID, bytes.fromhex("300000")), 1011)
    assert node.next(1011) is None
    assert node.send(b"free")


@pytest.mark.parametrize(("flow", "end"), [("32", "overflow"), ("33", "flow"), ("3f", "flow")])
def test_refusal_of_the_receiver_ends_sending(flow: str, end: str) -> None:
    node = IsotpEnd()
    assert node.send(payload(100))
    assert node.next(0) is not None
    node.take(Frame(REQUEST_ID, bytes.fromhex(flow + "0000")), 1)
    assert (node.state.sent, node.next(2)) == (end, None)


def test_waits_are_borne_twice_in_a_row_and_each_gives_a_new_second() -> None:
    wait, go = (Frame(REQUEST_ID, bytes.fromhex(text)) for text in ("310000", "300000"))
    patient = IsotpEnd()
    assert patient.send(payload(20))
    assert patient.next(0) is not None
    patient.take(wait, 900)
    patient.take(wait, 1800)
    patient.take(go, 2700)
    assert patient.next(2700) is not None
    slow = IsotpEnd()  # a receiver that waits before each of its blocks
    assert slow.send(payload(60))
    assert slow.next(0) is not None
    for now in range(1, 7):
        slow.take(wait, now)
        slow.take(Frame(REQUEST_ID, bytes.fromhex("300100")), now)
        assert slow.next(now) is not None, now
    tired = IsotpEnd()
    assert tired.send(payload(20))
    assert tired.next(0) is not None
    for now in (1, 2, 3):
        tired.take(wait, now)
    assert tired.state.sent == "waits"


def test_flow_control_that_comes_twice_changes_nothing() -> None:
    node, go = IsotpEnd(), Frame(REQUEST_ID, bytes.fromhex("300000"))
    assert node.send(payload(27))
    sent = [node.next(0)]
    node.take(go, 1)
    sent.append(node.next(1))
    node.take(go, 1)
    sent += [node.next(1), node.next(1)]
    expected = [frame.data.ljust(8, b"\xcc") for frame in segments(payload(27))]
    assert [frame.data for frame in sent if frame] == expected
    assert (node.state.sent, node.state.unexpected) == ("done", 1)


@pytest.mark.parametrize("held", [False, True])
def test_message_that_finds_no_room_is_refused_at_its_first_frame(held: bool) -> None:
    """One of 4096 bytes, by its 32-bit length; any while the last one was not taken, which is kept."""
    node = IsotpEnd()
    if held:
        for text in (b"\x03one", b"\x03two"):
            node.take(Frame(REQUEST_ID, text), 0)
    node.take(segments(payload(20))[0] if held else Frame(REQUEST_ID, bytes.fromhex("1000000010000102")), 0)
    refusal = node.next(0)
    assert refusal is not None
    assert refusal.data[0] == 0x32
    assert (node.state.received, node.state.dropped) == (("done", 2) if held else ("overflow", 0))
    assert (node.next(1), node.receive(), node.receive()) == (None, b"one" if held else b"", b"")
    for frame in (*segments(payload(50))[:3], *segments(payload(30))):  # a new one takes the place of the one under way
        node.take(frame, 3)
    assert (node.receive(), node.state.replaced) == (payload(30), 1)


def test_end_of_the_last_message_says_nothing_of_the_next_one() -> None:
    """Both ways; to let go of what was received ends no message that is under way."""
    node, go = IsotpEnd(), Frame(REQUEST_ID, bytes.fromhex("300000"))
    first, *rest = segments(payload(20))
    node.take(Frame(REQUEST_ID, b"\x03one"), 0)
    assert node.send(b"one")
    assert node.next(0) is not None
    assert (node.receive(), node.state.received, node.state.sent) == (b"one", "done", "done")
    node.take(first, 1)
    assert node.send(payload(20))
    assert node.next(1) is not None
    assert (node.receive(), node.state.received, node.state.sent) == (b"", "none", "none")
    for frame in (go, *rest):
        node.take(frame, 2)
    assert (node.receive(), node.state.received) == (payload(20), "done")


@pytest.mark.parametrize(
    "data", ["", "00", "08", "0801020304050607", "0301", "10", "1007010203040506", "30", "40", "ff"]
)
def test_malformed_frames_are_counted_and_change_nothing(data: str) -> None:
    node = IsotpEnd()
    node.take(Frame(REQUEST_ID, bytes.fromhex(data)), 0)
    assert (node.state.malformed, node.receive(), node.next(0)) == (1, b"", None)


def test_frame_that_is_cut_short_is_no_part_of_its_message() -> None:
    """The whole one that follows it is."""
    node = IsotpEnd()
    first, second, third = segments(payload(20))
    for frame in (first, Frame(REQUEST_ID, second.data[:7]), second, third):
        node.take(frame, 0)
    assert (node.state.malformed, node.receive()) == (1, payload(20))


@pytest.mark.parametrize("message", [b"", payload(4096)])
def test_lengths_that_cannot_be_are_not_sent(message: bytes) -> None:
    node = IsotpEnd()
    assert not node.send(message)
    assert node.next(0) is None


def test_every_length_arrives_and_a_damaged_frame_delivers_nothing_wrong() -> None:
    """Also: nothing reads or writes outside its buffers."""
    checks = ("-std=c11", "-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
    sources = (C_SOURCES / "wire_invariants.c", CAN / "isotp.c")
    path = program("wire_invariants", sources, (*checks, *WARNINGS, f"-I{CAN}"))
    checked = subprocess.run([path], capture_output=True, text=True, check=False)
    assert checked.returncode == 0, checked.stdout + checked.stderr

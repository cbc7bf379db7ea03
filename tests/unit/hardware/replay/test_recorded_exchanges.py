"""Exchanges from the frames of a traffic log: whole messages, requests with their answers, patterns and maps."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from struct import pack
from tempfile import TemporaryDirectory

import can
import numpy as np
import pytest
from can.io import BLFWriter
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from inkloop_hardware.errors import BusError, NodeLost, ReplayDiffers, ReplayEnded
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.transfer_bytes import PatternBytes, first_difference, plain_form
from inkloop_hardware.replay.recorded_exchanges import Exchange, Reassembly, Seen, exchanges, read_traffic
from inkloop_hardware.replay.recorded_nodes import RecordedNodes, described

CODEC = Codec()
LOG = Path("traffic.blf")


def frames_of(message: bytes) -> Iterator[bytes]:
    """A message cut into ISO-TP frames."""
    if len(message) <= 7:
        yield bytes([len(message)]) + message
        return
    yield pack(">H", 0x1000 | len(message)) + message[:6]
    for number, at in enumerate(range(6, len(message), 7), 1):
        yield bytes([0x20 | number % 16]) + message[at : at + 7]


def seen(*messages: tuple[Node, bool, bytes]) -> list[Seen]:
    """The log of messages: node, whether it is a request, bytes."""
    log: list[Seen] = []
    for node, asks, message in messages:
        identifier = CODEC.request_id(node) if asks else CODEC.answer_id(node)
        log += [Seen(len(log) * 1e-3, asks, Frame(identifier, data)) for data in frames_of(message)]
    return log


def routine(routine: Routine, layer: int = 1, number: int = 0) -> tuple[bytes, bytes]:
    """A request and its answer."""
    key = bytes(Key(9, layer, number))
    return pack(">BBH", 0x31, 1, routine) + key, pack(">BBHB", 0x71, 1, routine, 0) + key


@given(st.binary(min_size=1, max_size=4095))
def test_message_comes_out_of_its_frames(message: bytes) -> None:
    way = Reassembly()
    assert [found for data in frames_of(message) if (found := way.take(data))] == [message]


def test_message_that_lacks_a_frame_or_has_one_twice_is_dropped() -> None:
    frames = list(frames_of(bytes(100)))
    for altered in (frames[:3] + frames[4:], frames[:3] + frames[2:]):
        way = Reassembly()
        assert not [found for data in [*altered, *frames_of(b"\1\2")] if (found := way.take(data)) and len(found) > 2]


def test_retry_late_answer_and_still_busy_leave_one_exchange() -> None:
    asked, answer = routine(Routine.PASS)
    busy = b"\x7f\x31\x78"
    log = seen(
        (Node.HEAD, True, asked),
        (Node.HEAD, False, busy),
        (Node.HEAD, True, asked),
        (Node.HEAD, False, busy),
        (Node.HEAD, False, answer),
        (Node.HEAD, False, answer),
    )
    assert [(one.request, one.answer) for one in exchanges(log, CODEC)] == [(asked, answer)]


def download(blob: bytes, *lost: int, block: int = 10) -> list[tuple[Node, bool, bytes]]:
    """A pattern in blocks; of those in `lost` the answer is, and the node is asked what it took."""
    messages = [(Node.HEAD, True, pack(">BBBII", 0x34, 0, 0x44, 1, len(blob))), (Node.HEAD, False, b"\x74\x20\x0f\xff")]
    for number, at in enumerate(range(0, len(blob), block), 1):
        messages.append((Node.HEAD, True, bytes([0x36, number]) + blob[at : at + block]))
        if number not in lost:
            messages.append((Node.HEAD, False, bytes([0x76, number])))
            continue
        taken = pack(">BBHIII", 1, number + 1, 1, 9, min(at + block, len(blob)), len(blob))
        messages += [(Node.HEAD, True, b"\x22\x01\x04"), (Node.HEAD, False, b"\x62\x01\x04" + taken)]
    crc = pack(">I", zlib.crc32(blob))
    return [*messages, (Node.HEAD, True, b"\x37" + crc), (Node.HEAD, False, b"\x77" + crc)]


@pytest.mark.parametrize("lost", [(), (2,), (1, 4)])
def test_pattern_is_whole_also_where_an_answer_was_lost(lost: tuple[int, ...]) -> None:
    blob = bytes(range(35))
    (found,) = exchanges(seen(*download(blob, *lost)), CODEC)
    assert found.blob == blob


def test_failed_transfer_counts_only_if_it_was_not_begun_again() -> None:
    altered = download(bytes(35))
    altered[2] = (Node.HEAD, True, b"\x36\x01" + b"\xff" * 10)
    (lost,) = exchanges(seen(*altered), CODEC)
    assert (lost.answer, lost.blob) == (b"", None)
    (found,) = exchanges(seen(*altered, *download(bytes(35))), CODEC)
    assert found.blob == bytes(35)
    step, answer = routine(Routine.PASS)
    between = ((Node.HEAD, True, step), (Node.HEAD, False, answer))
    kinds = [(one.answer[:1], one.blob) for one in exchanges(seen(*altered, *between, *download(bytes(35))), CODEC)]
    assert kinds == [(b"", None), (b"\x71", None), (b"\x74", bytes(35))]


@pytest.mark.parametrize(
    ("node", "request_", "text"),
    [
        (Node.HEAD, routine(Routine.PASS, 7, 1)[0], f"head for pass of {Key(9, 7, 1)}"),
        (Node.HEAD, pack(">BBBII", 0x34, 0, 0x44, 7, 100), "head to take the pattern of layer 7"),
        (Node.PROFILER, pack(">BBBII", 0x35, 0, 0x44, 8, 100), "profiler to give the map of layer 8"),
        (Node.STAGE, b"\x22\x01\x02", "stage for identifier 0102 (limits)"),
        (Node.STAGE, b"\x22\x77\x02", "stage for identifier 7702 (unknown)"),
        (Node.CURE, b"\x3e\x80", "cure with 3e 80"),
    ],
)
def test_request_is_described_by_what_it_asks_of_the_node(node: Node, request_: bytes, text: str) -> None:
    assert described(node, request_) == text


@given(arrays(np.uint8, st.tuples(st.integers(1, 40), st.integers(1, 40)), elements=st.integers(0, 2)))
def test_plain_form_of_a_coded_pattern_is_the_plain_one(pattern: np.ndarray) -> None:
    made = PatternBytes.of(pattern, passes=4, materials=2)
    assert plain_form(made.coded, True) == plain_form(made.plain, False) == made.plain


@pytest.mark.parametrize("materials", [1, 2])
@pytest.mark.parametrize("cell", [(0, 0), (3, 5), (10, 8)])
def test_first_cell_that_differs_is_found(cell: tuple[int, int], materials: int) -> None:
    pattern = np.zeros((11, 9), np.int32)
    before = PatternBytes.of(pattern, passes=1, materials=materials).plain
    pattern[cell] = 1
    after = PatternBytes.of(pattern, passes=1, materials=materials).plain
    assert first_difference(before, after) == cell
    assert first_difference(after, after) is None


def recorded() -> RecordedNodes:
    """A move, a pass, and the state of the head that was read before."""
    found = [
        Exchange(Node.HEAD, b"\x22\x01\x00", b"\x62\x01\x00", 1),
        Exchange(Node.STAGE, *routine(Routine.MOVE), 3),
        Exchange(Node.HEAD, *routine(Routine.PASS), 5),
    ]
    return RecordedNodes(found, LOG)


def test_requests_that_do_not_affect_the_print_may_be_repeated_or_left_out() -> None:
    nodes = recorded()
    assert nodes.answer(Node.STAGE, routine(Routine.MOVE)[0])[1] == 3
    nodes = recorded()
    for _ in range(2):
        assert nodes.answer(Node.HEAD, b"\x22\x01\x00")[0] == b"\x62\x01\x00"


def test_order_of_a_layer_is_that_of_the_log() -> None:
    with pytest.raises(ReplayDiffers, match=r"head for pass of layer 1, pass 0, in the log comes the stage for move"):
        recorded().answer(Node.HEAD, routine(Routine.PASS)[0])


def test_other_pass_and_the_end_of_the_log_are_reported_with_the_request() -> None:
    nodes = recorded()
    nodes.answer(Node.STAGE, routine(Routine.MOVE)[0])
    with pytest.raises(ReplayDiffers, match=r"pass of layer 1, pass 2.* first differing byte is 10"):
        nodes.answer(Node.HEAD, routine(Routine.PASS, number=2)[0])
    nodes.answer(Node.HEAD, routine(Routine.PASS)[0])
    with pytest.raises(ReplayEnded, match=r"ends here: the master asks the cure for cure of layer 1, pass 0"):
        nodes.answer(Node.CURE, routine(Routine.CURE)[0])


def test_step_without_an_answer_is_lost_again() -> None:
    asked, answer = routine(Routine.PASS)
    log = seen(
        (Node.HEAD, True, asked),
        (Node.HEAD, True, b"\x22\x01\x00"),
        (Node.HEAD, False, b"\x62\x01\x00"),
        (Node.HEAD, True, asked),
        (Node.HEAD, False, answer),
    )
    nodes = RecordedNodes(exchanges(log, CODEC), LOG)
    with pytest.raises(NodeLost, match="as in the recorded run"):
        nodes.answer(Node.HEAD, asked)
    nodes.answer(Node.HEAD, b"\x22\x01\x00")
    assert nodes.answer(Node.HEAD, asked)[0] == answer


def test_where_a_run_was_resumed_its_layer_is_begun_again() -> None:
    move, cure = routine(Routine.MOVE), routine(Routine.CURE)
    found = [Exchange(Node.STAGE, *move, 3), Exchange(Node.STAGE, *move, 13), Exchange(Node.CURE, *cure, 15)]
    nodes = RecordedNodes(found, LOG, begins=[10])
    nodes.answer(Node.STAGE, move[0])
    with pytest.raises(NodeLost, match="interrupted here and resumed"):
        nodes.answer(Node.CURE, cure[0])
    nodes.answer(Node.STAGE, move[0])
    assert nodes.answer(Node.CURE, cure[0])[1] == 15


def read_or_message(path: Path) -> tuple[list[Seen], str]:
    """The frames of a log, and the message where it is none."""
    try:
        return read_traffic(path), ""
    except BusError as error:
        return [], str(error)


BEGINNINGS = (b"", b"LOGG", b"date Sat\nbase hex\n")


@given(st.sampled_from([".blf", ".asc"]), st.sampled_from(BEGINNINGS), st.binary(max_size=400))
def test_any_file_is_a_log_or_gives_a_message(suffix: str, begin: bytes, rest: bytes) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"traffic{suffix}"
        path.write_bytes(begin + rest)
        found, message = read_or_message(path)
    assert str(path) in message or not message
    assert all(0 <= one.frame.arbitration_id < 2048 for one in found)


@pytest.mark.parametrize("share", [0.3, 0.7, 0.99])
def test_log_that_was_cut_off_gives_its_first_frames_or_a_message(share: float, tmp_path: Path) -> None:
    path = tmp_path / "traffic.blf"
    with BLFWriter(path) as writer:
        for number in range(3000):
            writer.on_message_received(can.Message(number / 1e3, 0x101, False, data=[number % 256] * 8))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    found, message = read_or_message(path)
    assert "damaged" in message or not message
    assert [one.frame.data[0] for one in found] == [number % 256 for number in range(len(found))]

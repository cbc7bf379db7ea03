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
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.bus.traffic_log import TrafficLog
from inkloop_hardware.errors import BusError, NodeLost, ReplayDiffers, ReplayEnded
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.transfer_bytes import PatternBytes, first_difference, plain_form
from inkloop_hardware.replay.recorded_exchanges import (
    Exchange,
    Reassembly,
    Seen,
    exchanges,
    parts_of,
    read_traffic,
)
from inkloop_hardware.replay.recorded_nodes import RecordedNodes, described
from inkloop_hardware.replay.replay_connection import ReplayConnection

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
@example(bytes(range(251)) * 16)
def test_message_comes_out_of_its_frames(message: bytes) -> None:
    way = Reassembly()
    assert [found for data in frames_of(message) if (found := way.take(data))] == [message]


def test_message_that_lacks_a_frame_or_has_one_twice_is_dropped() -> None:
    frames = list(frames_of(bytes(100)))
    for altered in (frames[:3] + frames[4:], frames[:3] + frames[2:]):
        way = Reassembly()
        assert not [found for data in [*altered, *frames_of(b"\1\2")] if (found := way.take(data)) and len(found) > 2]


def test_short_message_ends_the_one_that_was_under_way() -> None:
    way = Reassembly()
    first, *rest = frames_of(bytes(range(30)))
    assert [way.take(data) for data in (first, b"\2\1\2", *rest)] == [None, b"\1\2", *len(rest) * [None]]


def test_first_answer_counts_and_the_exchange_ends_with_it() -> None:
    asked, answer = routine(Routine.PASS)
    again = answer[:4] + b"\1" + answer[5:]
    log = seen((Node.HEAD, True, asked), (Node.HEAD, False, answer), (Node.HEAD, False, again))
    (found,) = exchanges(log, CODEC)
    assert (found.answer, found.at) == (answer, 3), "a request and an answer of two frames each"


def test_exchanges_of_all_nodes_are_in_the_order_of_their_ends() -> None:
    move, cure = routine(Routine.MOVE), routine(Routine.CURE)
    log = seen(
        (Node.CURE, True, cure[0]),
        (Node.STAGE, True, move[0]),
        (Node.STAGE, False, move[1]),
        (Node.CURE, False, cure[1]),
    )
    found = [(one.node, one.at) for one in exchanges(log, CODEC)]
    assert found == [(Node.STAGE, 5), (Node.CURE, 7)]
    state = (Node.HEAD, True, b"\x22\1\0"), (Node.HEAD, False, b"\x62\1\0")
    head = seen((Node.CURE, True, cure[0]), (Node.CURE, False, cure[1]), *state)
    assert [one.node for one in exchanges(head, CODEC)] == [Node.CURE, Node.HEAD]


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (routine(Routine.PASS)[0], True),
        (b"\x31\3" + routine(Routine.PASS)[0][2:], False),
        (routine(Routine.HOME)[0], False),
        (b"\x34\0\x44", True),
        (b"\x35\0\x44", True),
        (b"\x22\1\0", False),
    ],
)
def test_part_depends_on_steps_patterns_and_maps_and_on_no_question(request_: bytes, expected: bool) -> None:
    assert Exchange(Node.HEAD, request_, b"", 1).is_of_a_layer is expected


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


def test_block_whose_fate_was_asked_for_twice_is_taken_once() -> None:
    blob = bytes(range(35))
    messages = download(blob, 2)
    at = next(k for k, (_, asks, message) in enumerate(messages) if asks and message == b"\x22\x01\x04")
    twice = [*messages[: at + 2], *messages[at : at + 2], *messages[at + 2 :]]
    (found,) = exchanges(seen(*twice), CODEC)
    assert found.blob == blob


def upload(blob: bytes, crc: int | None = None) -> list[tuple[Node, bool, bytes]]:
    """A map in blocks of ten bytes, of which the last one is asked for with a limit."""
    node, pieces = Node.PROFILER, [blob[at : at + 10] for at in range(0, len(blob), 10)]
    messages = [(node, True, pack(">BBBII", 0x35, 0, 0x44, 1, len(blob))), (node, False, b"\x75\x20\x00\x0c")]
    for number, piece in enumerate(pieces, 1):
        limit = b"\0\x0c" if number == len(pieces) else b""
        messages += [(node, True, bytes([0x36, number]) + limit), (node, False, bytes([0x76, number]) + piece)]
    end = pack(">BI", 0x77, zlib.crc32(blob) if crc is None else crc)
    return [*messages, (node, True, b"\x37"), (node, False, end)]


def test_map_is_whole_and_given_again_in_the_blocks_that_are_asked_for() -> None:
    blob, (move, moved) = bytes(range(35)), routine(Routine.MOVE)
    log = seen((Node.STAGE, True, move), (Node.STAGE, False, moved), *upload(blob))
    _, found = exchanges(log, CODEC)
    end = pack(">BI", 0x77, zlib.crc32(blob))
    assert (found.node, found.blob, found.end, found.at) == (Node.PROFILER, blob, end, len(log) - 1)
    nodes = RecordedNodes(exchanges(log, CODEC), LOG)
    assert (nodes.job, nodes.first) == (9, 3)
    nodes.answer(Node.STAGE, move)
    begin = pack(">BBBII", 0x35, 0, 0x44, 1, 35)
    assert nodes.answer(Node.PROFILER, begin) == (b"\x75\x20\x00\x0c", -1)
    for request, piece in (
        (b"\x36\1", blob[:10]),
        (b"\x36\1", blob[:10]),  # a repeat
        (b"\x36\2\0\7", blob[10:15]),
        (b"\x36\3", blob[15:25]),
        (b"\x36\4", blob[25:]),
    ):
        assert nodes.answer(Node.PROFILER, request) == (bytes([0x76, request[1]]) + piece, -1)
    assert nodes.answer(Node.PROFILER, b"\x37") == (end, len(log) - 1)


def test_map_whose_checksum_was_wrong_is_lost() -> None:
    blob = bytes(range(35))
    (lost,) = exchanges(seen(*upload(blob, crc=1)), CODEC)
    assert (lost.answer, lost.blob) == (b"", None)
    (found,) = exchanges(seen(*upload(blob, crc=1), *upload(blob)), CODEC)
    assert found.blob == blob


SHAPE = (3, 7)


def made(cells: np.ndarray) -> PatternBytes:
    return PatternBytes.of(cells, passes=4, materials=2)


def replayed(theirs: bytes, ours: bytes, coding: tuple[int, int], layer: int = 1) -> tuple[bytes, int]:
    """The answer to the end of a pattern of a layer, where another one is in the log for layer 1."""
    begin = [pack(">BBBII", 0x34, code, 0x44, of, 99) for code, of in zip(coding, (1, layer), strict=True)]
    step = Exchange(Node.HEAD, *routine(Routine.HOME), 1)
    nodes = RecordedNodes([step, Exchange(Node.HEAD, begin[0], b"\x74\x20\x0f\xff", 8, theirs, b"\x77old")], LOG)
    assert nodes.answer(Node.HEAD, begin[1]) == (b"\x74\x20\x0f\xff", -1)
    for number, at in enumerate(range(0, len(ours), 5), 1):
        for _ in range(2):  # a repeat is not taken twice
            assert nodes.answer(Node.HEAD, bytes([0x36, number]) + ours[at : at + 5]) == (bytes([0x76, number]), -1)
    return nodes.answer(Node.HEAD, b"\x37" + pack(">I", zlib.crc32(ours)))


def test_same_pattern_may_come_in_another_form_and_another_one_is_reported_with_its_cell() -> None:
    cells = np.ones(SHAPE, np.int32)
    other = cells.copy()
    other[2, 4] = 2
    one, two = made(cells), made(other)
    forms = {0: one.plain, 0x10: one.coded}
    for theirs, ours in ((0, 0x10), (0x10, 0), (0x10, 0x10), (0, 0)):
        answer, at = replayed(forms[theirs], forms[ours], (theirs, ours))
        assert (answer, at) == (pack(">BI", 0x77, zlib.crc32(forms[ours])), 8)
    with pytest.raises(
        ReplayDiffers,
        match=r"the pattern of layer 1 differs at byte 12 \(cell 2, 4\): 0x59, in the log 0x55$",
    ):  # cells 16 to 19 in two bits each, of which 18 is the other one
        replayed(one.coded, two.plain, (0x10, 0))
    with pytest.raises(ReplayDiffers, match=r"the pattern of layer 1 has 9 bytes, in the log 14$"):
        replayed(one.plain, one.plain[:9], (0, 0))
    head = made(np.ones((7, 3), np.int32)).plain
    with pytest.raises(
        ReplayDiffers, match=r"differs at byte 3 \(its head: grid, passes or materials\): 0x07, .* 0x03$"
    ):
        replayed(one.plain, head, (0, 0))
    with pytest.raises(ReplayDiffers, match=r"to take the pattern of layer 2, in the log comes the head to take .* 1;"):
        replayed(one.plain, one.plain, (0, 0), layer=2)


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
    other = PatternBytes.of(pattern, passes=2, materials=materials).plain
    assert first_difference(before, other) is None  # of patterns with other heads no cell is the same


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


def test_resumed_run_whose_first_request_was_lost_is_resumed_there() -> None:
    move, cure = routine(Routine.MOVE), routine(Routine.CURE)
    found = [Exchange(Node.STAGE, *move, 3), Exchange(Node.STAGE, move[0], b"", 10), Exchange(Node.STAGE, *move, 15)]
    nodes = RecordedNodes(found, LOG, begins=[10])
    nodes.answer(Node.STAGE, move[0])
    with pytest.raises(NodeLost, match="interrupted here and resumed"):
        nodes.answer(Node.CURE, cure[0])
    with pytest.raises(NodeLost, match="as in the recorded run, no answer of the stage for move"):
        nodes.answer(Node.STAGE, move[0])
    with pytest.raises(ReplayDiffers, match="asks the cure"):
        nodes.answer(Node.CURE, cure[0])
    assert nodes.answer(Node.STAGE, move[0])[1] == 15


def test_request_that_is_longer_than_that_of_the_log_differs_at_its_end() -> None:
    asked, answer = routine(Routine.PASS)
    nodes = RecordedNodes([Exchange(Node.HEAD, asked, answer, 1)], LOG)
    with pytest.raises(ReplayDiffers, match="their first differing byte is 12:"):
        nodes.answer(Node.HEAD, asked + b"\1")


@pytest.mark.parametrize("suffix", [".blf", ".asc"])
def test_sent_frame_stands_before_the_answer_of_the_same_time_and_times_are_absolute(
    suffix: str, tmp_path: Path
) -> None:
    """A request is logged once it has left."""
    log = TrafficLog(tmp_path / f"traffic{suffix}", float)
    for at, sent, number in ((2.0, False, 1), (1.0, False, 2), (1.0, True, 3), (2.0, True, 4)):
        message = can.Message(1.7e9 + at, number, False, data=[number], is_rx=not sent)
        log.take(message)
    log.close()
    found = read_traffic(tmp_path / f"traffic{suffix}")
    assert [(one.frame.arbitration_id, one.sent) for one in found] == [(3, True), (2, False), (4, True), (1, False)]
    assert [one.at - found[0].at for one in found] == pytest.approx([0.0, 0.0, 1.0, 1.0], rel=0.0, abs=1e-5)
    assert found[0].at == pytest.approx(1.7e9, rel=0.0, abs=86_400.0), "to the day, whatever the zone of the machine"


def test_replay_passes_on_what_the_nodes_said_of_themselves(tmp_path: Path) -> None:
    """Statuses and faults up to the first answer, and neither requests nor answers."""
    path, (asked, answer) = tmp_path / "traffic.blf", routine(Routine.HOME)
    said = [(Node.HEAD, "Status"), (Node.CURE, "Fault"), (Node.STAGE, "Status"), (Node.STAGE, "Fault")]
    own = [Frame(CODEC.message(f"{node}{kind}").frame_id, bytes([number])) for number, (node, kind) in enumerate(said)]
    asks, answers = (
        [one.frame for one in seen((Node.STAGE, way, text))] for way, text in ((True, asked), (False, answer))
    )
    log = TrafficLog(path, float)
    for at, frame in enumerate([*own[:2], *asks, *answers[:1], own[2], *answers[1:], own[3]]):
        log.take(can.Message(1.7e9 + at, frame.arbitration_id, False, data=frame.data, is_rx=frame not in asks))
    log.close()
    replay = ReplayConnection(BusSettings("replay", str(path)))
    assert [frame for _, frame in replay.others] == own[:3]
    assert replay.job == 9


def test_log_of_a_resumed_run_has_all_its_parts_in_their_order(tmp_path: Path) -> None:
    assert parts_of(tmp_path / "traffic.blf") == [tmp_path / "traffic.blf"]
    names = ["traffic.blf", "traffic-2.blf", "traffic-3.blf"]
    for name in (*names, "traffic-5.blf"):
        (tmp_path / name).touch()
    assert parts_of(tmp_path / "traffic.blf") == [tmp_path / name for name in names]


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

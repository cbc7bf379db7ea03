"""Patterns and maps over a wire that loses, doubles and alters frames arrive unchanged, or an error is raised."""

from __future__ import annotations

import zlib
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from struct import pack
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from udsoncan.exceptions import TimeoutException

from inkloop_hardware.bus.isotp_connection import ANSWER_LIMIT, IsoTpConnection
from inkloop_hardware.errors import LinkTimeout, NodeLost, NodeRefused, TransferError
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.requests import DeadlinePassed, Requests
from inkloop_hardware.link.transfers import BlockSize, receive_map, send_pattern
from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.node_state import Flags, MapSize, TransferFlags, TransferState
from inkloop_hardware.protocol.records import Node, State
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from inkloop_hardware.protocol.transfer_bytes import CELLS_MAX, map_size
from support.benches.faulty_wire import CODEC, FaultyWire
from support.benches.node_bench import CURE, HEAD, PROFILER, RASTER, NodeBench, pattern_blob, run_length
from support.benches.node_status import node_state

pytestmark = pytest.mark.compiled

JOB = 7
BLOCK, ANSWER, EXIT = 0x36, 0x76, 0x37


@pytest.fixture
def bench() -> Iterator[NodeBench]:
    with NodeBench() as made:
        yield made.ready()


def test_block_doubles_as_often_as_eight_went_through() -> None:
    size = BlockSize(4095)
    for _ in range(3):
        size.was_lost()
    lowest, found = size.bytes, []
    for _ in range(24):
        size.went_through()
        found.append(size.bytes // lowest)
    assert found[6:24:8] + found[7:24:8] == [1, 2, 4, 2, 4, 8]


def test_block_is_halved_down_to_its_floor_and_grows_again() -> None:
    size = BlockSize(4095)
    assert size.is_whole
    for expected in (2046, 1023, 511, 255, 254, 254):
        size.was_lost()
        assert size.bytes == expected
    for _ in range(8):
        size.went_through()
    assert size.bytes == 508
    for _ in range(7):
        size.went_through()
    size.was_lost()
    for _ in range(7):
        size.went_through()
    assert size.bytes == 254, "eight in a row"
    size.went_through()
    assert size.bytes == 508
    assert BlockSize(0xFFFF).bytes == 4093
    small = BlockSize(100)
    assert small.bytes == 98, "a node that takes less than the floor"
    small.was_lost()
    assert small.bytes == 98


def random_pattern(cells: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 3, (cells, cells)).astype(np.uint8)


def nth(
    which: int, is_it: Callable[[Frame], bool], then: Callable[[Frame], Frame | None]
) -> Callable[[Frame], Frame | None]:
    """Something happens to the `which`-th frame of a kind, counted from 0."""
    seen = iter(range(1 << 30))
    return lambda frame: then(frame) if is_it(frame) and next(seen) == which else frame


def kind(frame: Frame) -> int:
    """0 single, 1 first, 2 consecutive, 3 flow control."""
    return frame.data[0] >> 4


def is_single(frame: Frame, service: int) -> bool:
    return kind(frame) == 0 and frame.data[1] == service


def lose(frame: Frame) -> None:
    return None


def change(frame: Frame) -> Frame:
    return Frame(frame.arbitration_id, frame.data[:4] + bytes([frame.data[4] ^ 0x40]) + frame.data[5:])


@pytest.mark.parametrize("cells", [1, 9, 40])
@pytest.mark.parametrize("coded", [False, True])
def test_pattern_arrives_as_it_was_sent(cells: int, coded: bool) -> None:
    blob = pattern_blob(random_pattern(cells))
    sent = run_length(blob) if coded else blob
    moved: list[tuple[int, int]] = []
    with NodeBench(nx=cells, ny=cells) as bench:
        link = FaultyWire(bench.ready()).link()
        link.download(1, sent, coded=coded, progress=lambda done, total: moved.append((done, total)))
        assert link.state().pattern_crc == zlib.crc32(sent)
        assert (link.counts.repeated, link.counts.stray, link.counts.broken, link.counts.restarted) == (0, 0, 0, 0)
    assert moved[-1] == (len(sent), len(sent))


def test_map_arrives_as_it_is_in_the_node() -> None:
    with NodeBench(nx=80, ny=70, noise_std=1e-6) as bench:
        assert bench.ready().scan(0) == 0
        assert FaultyWire(bench, PROFILER).link().upload(0) == bench.upload(0)


@pytest.mark.parametrize("seed", range(6))
def test_layer_over_a_lossy_wire_is_right_and_jetted_once(seed: int) -> None:
    """One frame in 500 is lost and one comes twice, both ways: every pass once, and bytes as they were."""
    blob = pattern_blob(random_pattern(40, seed))
    faults: dict[str, Any] = {"seed": seed, "loss": 2e-3, "repeat": 2e-3}
    with NodeBench(nx=40, ny=40, noise_std=1e-6) as bench:
        wires = {node: FaultyWire(bench, node, **faults) for node in (HEAD, CURE, PROFILER)}
        links = {node: wire.link() for node, wire in wires.items()}
        bench.ready()
        links[HEAD].download(1, blob)
        for number, colour in enumerate(RASTER):
            key = Key(JOB, 1, number)
            assert links[HEAD].routine(Routine.PASS, key, bytes([colour]), limit_s=30) <= Outcome.DONE_BEFORE
            assert links[CURE].routine(Routine.CURE, key, b"\0\x14", limit_s=30) <= Outcome.DONE_BEFORE
        assert links[PROFILER].routine(Routine.SCAN, Key(JOB, 1), limit_s=30) <= Outcome.DONE_BEFORE
        assert links[PROFILER].upload(1) == bench.upload(1)
        assert (bench.state().gate_pulses, bench.state().pattern_crc) == (4, zlib.crc32(blob))


def test_20_kB_and_a_map_with_a_frame_in_1000_lost_take_less_than_15_s() -> None:
    """By the nodes' clock, the wire itself being as fast as one likes."""
    pattern = np.random.default_rng(1).integers(0, 2, (400, 400))
    with NodeBench(nx=400, ny=400) as large, NodeBench(nx=100, ny=100) as small:
        head, profiler = FaultyWire(large.ready(), seed=1, loss=1e-3), FaultyWire(small.ready(), PROFILER, loss=1e-3)
        assert small.scan(0) == 0
        began = large.clock + small.clock
        head.link().download(1, pattern_blob(pattern, bits=1))
        profiler.link().upload(0)
        assert head.lost + profiler.lost > 3
        assert large.clock + small.clock - began < 12_000, "3 s are left for passes and scan"


@pytest.mark.parametrize("which", range(3))
def test_block_whose_answer_is_lost_is_not_sent_again(which: int) -> None:
    blob = pattern_blob(random_pattern(200))
    with NodeBench(nx=200, ny=200) as bench:
        wire = FaultyWire(bench.ready(), alter=nth(which, lambda frame: is_single(frame, ANSWER), lose))
        link = wire.link()
        link.download(1, blob)
        assert bench.state().pattern_crc == zlib.crc32(blob)
        assert (wire.lost, link.counts.restarted) == (1, 0)


def test_block_of_a_map_that_is_cut_off_is_asked_for_in_smaller_pieces() -> None:
    asked: list[bytes] = []
    cut = nth(500, lambda frame: frame.arbitration_id == 0x647 and kind(frame) == 2, lose)

    def take_note(frame: Frame) -> Frame | None:
        if frame.arbitration_id == 0x646 and is_single(frame, BLOCK):
            asked.append(frame.data[1 : 1 + frame.data[0]])
        return cut(frame)

    with NodeBench(nx=80, ny=70, noise_std=1e-6) as bench:
        assert bench.ready().scan(0) == 0
        link = FaultyWire(bench, PROFILER, alter=take_note).link()
        assert link.upload(0) == bench.upload(0)
        assert link.counts.restarted == 0
    assert asked[:3] == [b"\x36\x01", b"\x36\x01\x07\xfe", b"\x36\x02\x07\xfe"], "2046 bytes instead of 4093"


def fifth(frame: Frame) -> bool:
    """A frame from the middle of a block."""
    return frame.data[0] == 0x25


@pytest.mark.parametrize("often", [1, 2])
def test_altered_byte_is_found_and_the_pattern_sent_once_more(often: int) -> None:
    """Once more; then an error reports the bad connection."""
    blob = pattern_blob(np.ones((20, 20)), bits=1)
    count = iter(range(100))

    def alter(frame: Frame) -> Frame:
        return change(frame) if fifth(frame) and next(count) < often else frame

    with NodeBench(nx=20, ny=20) as bench:
        link = FaultyWire(bench.ready(), alter=alter).link()
        if often == 1:
            link.download(1, blob)
        else:
            with pytest.raises(TransferError, match=r"checksum differs.*cables"):
                link.download(1, blob)
        assert link.counts.restarted == 1
        assert (bench.state().pattern_crc == zlib.crc32(blob)) == bench.state().pattern_loaded == (often == 1)


@pytest.mark.parametrize("often", [1, 2])
def test_altered_block_counter_is_refused_and_the_pattern_sent_once_more(often: int, bench: NodeBench) -> None:
    """The node answers 0x73 and keeps nothing of the block; twice, then an error is raised."""
    blob, count, answers = pattern_blob(random_pattern(9)[:, :8]), iter(range(100)), []

    def alter(frame: Frame) -> Frame:
        if frame.data[:3] == b"\x03\x7f\x36":
            answers.append(frame.data[3])
        if kind(frame) != 1 or frame.data[2] != BLOCK or next(count) >= often:
            return frame
        return Frame(frame.arbitration_id, frame.data[:3] + b"\x09" + frame.data[4:])

    link = FaultyWire(bench, alter=alter).link()
    if often == 1:
        link.download(1, blob)
    else:
        with pytest.raises(TransferError, match="block 1 of the pattern of layer 1"):
            link.download(1, blob)
    assert answers == [0x73] * often
    assert link.counts.restarted == 1
    assert bench.state().pattern_loaded == (often == 1)


def test_altered_byte_of_a_map_is_found_and_the_map_fetched_once_more(bench: NodeBench) -> None:
    assert bench.scan(0) == 0
    link = FaultyWire(bench, PROFILER, alter=nth(0, fifth, change)).link()
    assert link.upload(0) == bench.upload(0)
    assert link.counts.restarted == 1


class LateWire(FaultyWire):
    """Answers stay on the way, in their order, for 1.2 s: until after their requests were given up and sent again.
    It happens `count` times, to the first frames of a kind."""

    def __init__(self, bench: NodeBench, node: int, service: int, count: int) -> None:
        self.held: deque[Frame] = deque()
        self.until = 0
        self.service, self.left = service, count
        super().__init__(bench, node, alter=self.hold)

    def hold(self, frame: Frame) -> Frame | None:
        if frame.arbitration_id % 2 == 0:
            return frame
        service = frame.data[1:3][kind(frame)] if kind(frame) in (0, 1) else None
        if self.left and not self.held and service == self.service:
            self.left -= 1
            self.until = self.bench.clock + 1200
        if self.held or self.bench.clock < self.until:
            self.held.append(frame)
            return None
        return frame

    def receive(self, wait_s: float) -> bytes | None:
        if self.bench.clock >= self.until:
            self.waiting.extend(frame.data for frame in self.held)
            self.held.clear()
        return super().receive(wait_s)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize(
    ("node", "service"),
    [*((HEAD, one) for one in (0x74, ANSWER, 0x77, 0x62)), *((PROFILER, one) for one in (0x75, ANSWER, 0x77))],
)
def test_late_answers_belong_to_nothing_any_more(node: int, service: int, count: int) -> None:
    blob = pattern_blob(random_pattern(200))
    with NodeBench(nx=200, ny=200) as large, NodeBench(nx=80, ny=70, noise_std=1e-6) as small:
        bench = large if node == HEAD else small
        wire = LateWire(bench.ready(), node, service, count)
        link = wire.link()
        if node == HEAD:
            assert link.state().state is State.IDLE
            link.download(1, blob)
            assert (bench.state().pattern_crc, link.state().state) == (zlib.crc32(blob), State.VERIFIED)
        else:
            assert bench.scan(0) == 0
            assert link.upload(0) == bench.upload(0)
        assert (wire.left < count, link.counts.restarted) == (True, 0)


class BrokenOff(FaultyWire):
    """The wait for the first short answer ends with Ctrl-C; that answer comes after the next request."""

    def __init__(self, bench: NodeBench) -> None:
        self.held: list[Frame] = []
        self.is_first = True
        super().__init__(bench, alter=self.hold)

    def hold(self, frame: Frame) -> Frame | None:
        if frame.arbitration_id % 2 == 0 or kind(frame) != 0 or not self.is_first:
            return frame
        self.held.append(frame)
        return None

    def receive(self, wait_s: float) -> bytes | None:
        if self.is_first and self.held:
            self.is_first = False
            raise KeyboardInterrupt
        if wait_s > 0.0:
            self.waiting.extendleft(frame.data for frame in reversed(self.held))
            self.held.clear()
        return super().receive(wait_s)


def test_late_answer_to_a_request_that_was_broken_off_is_not_that_of_the_next_one(bench: NodeBench) -> None:
    wire = BrokenOff(bench)
    link = wire.link()
    with pytest.raises(KeyboardInterrupt):
        link.routine(Routine.HOME, Key(JOB, 0), limit_s=30)  # which a head refuses
    assert [frame.data[1:3] for frame in wire.held] == [b"\x7f\x31"]
    assert link.ask(Routine.PASS, Key(JOB, 1)) is Outcome.NEVER


class SlowRefusals(FaultyWire):
    """A node that needs 1.2 s to refuse, for which a link waits 1 s; other answers come in their turn."""

    def __init__(self, bench: NodeBench) -> None:
        self.held: deque[tuple[int, Frame]] = deque()
        super().__init__(bench, alter=self.hold)

    def hold(self, frame: Frame) -> Frame | None:
        is_refusal = is_single(frame, 0x7F)
        if frame.arbitration_id % 2 == 0 or kind(frame) == 3 or not (is_refusal or self.held):
            return frame
        self.held.append((self.bench.clock + 1200 if is_refusal else self.held[-1][0], frame))
        return None

    def _turn(self) -> None:
        super()._turn()
        while self.held and self.held[0][0] <= self.bench.clock:
            self.waiting.append(self.held.popleft()[1].data)


def test_late_answer_to_a_request_that_was_repeated_is_not_that_of_the_next_one(bench: NodeBench) -> None:
    """The first answer ends the request; the second one is under way when the next request is sent."""
    wire = SlowRefusals(bench)
    link = wire.link()
    with pytest.raises(NodeRefused):
        link.routine(Routine.HOME, Key(JOB, 0), limit_s=30)  # which a head refuses
    link.pause(0.5)
    assert [frame.data[1:3] for _, frame in wire.held] == [b"\x7f\x31"]
    assert link.ask(Routine.PASS, Key(JOB, 1)) is Outcome.NEVER


def test_routine_that_has_failed_is_asked_for_once(bench: NodeBench) -> None:
    """A second try is for a node that lacks conditions; what began and gave up may not begin again."""

    def failed(frame: Frame) -> Frame:
        is_refusal = frame.data[1:3] == b"\x7f\x31"
        return frame._replace(data=frame.data[:3] + b"\x26" + frame.data[4:]) if is_refusal else frame

    link = FaultyWire(bench, alter=failed).link()
    with pytest.raises(NodeRefused, match=r"home of .* it is ") as caught:
        link.routine(Routine.HOME, Key(JOB, 0), limit_s=30)
    assert (caught.value.code, link.counts.repeated) == (0x26, 0)


@pytest.mark.parametrize(("routine", "option"), [(Routine.CLEAR, b"\1"), (Routine.PASS, b"\0"), (Routine.PURGE, b"")])
def test_routine_that_a_stop_forbids_is_asked_for_once(bench: NodeBench, routine: Routine, option: bytes) -> None:
    bench.stop(True)
    link = FaultyWire(bench).link()
    with pytest.raises(NodeRefused, match=r"it is SAFE \(stop request\)"):
        link.routine(routine, Key(JOB, 1), option, limit_s=30)
    assert link.counts.repeated == 0


def test_routine_may_last_as_long_as_its_limit() -> None:
    with NodeBench(clock=100_000, scan_ms=3_000) as bench:
        link = FaultyWire(bench.ready(), PROFILER).link()
        with pytest.raises(
            LinkTimeout, match=r"in time: scan of .*; asked for .* it answered: still under way\. `inkl"
        ):
            link.routine(Routine.SCAN, Key(JOB, 0), limit_s=1.5)
        bench.tick(3_000)
        assert link.ask(Routine.SCAN, Key(JOB, 0)) is Outcome.DONE_BEFORE


def test_routine_whose_answer_is_lost_until_its_time_is_over_is_done_by_its_outcome() -> None:
    def lose_the_answer(frame: Frame) -> Frame | None:
        return None if frame.data[0] == 0x10 and frame.data[2:4] == b"\x71\x01" else frame

    with NodeBench(clock=100_000, scan_ms=500) as bench:
        link = FaultyWire(bench.ready(), PROFILER, alter=lose_the_answer).link()
        assert link.routine(Routine.SCAN, Key(JOB, 0), limit_s=0.9) is Outcome.DONE_BEFORE


class PlainWire:
    """A wire without a node, on which nobody need be watched: every answer, a single frame, comes twice at once."""

    def __init__(self) -> None:
        self.seconds, self.coming, self.service = 0.0, deque[bytes](), 0

    def begin(self) -> None: ...

    def check(self) -> None: ...

    def now(self) -> float:
        return self.seconds

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            self.coming.extend(2 * [bytes([2, frame.data[1] + 0x40, frame.data[2]])])

    def receive(self, wait_s: float) -> bytes | None:
        return self.coming.popleft() if self.coming else None


class BusyWire(PlainWire):
    """A node that says once a second that it is still busy, whatever it is asked."""

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if kind(frame) in (0, 1):
                self.service = frame.data[1 + kind(frame)]
                self.coming.extend([b"\x30\0\0"] * kind(frame))

    def receive(self, wait_s: float) -> bytes | None:
        if self.coming or wait_s == 0.0:
            return super().receive(wait_s)
        self.seconds += 1.0
        return bytes([3, 0x7F, self.service, 0x78])


def test_node_that_is_busy_for_ever_is_given_up_also_without_a_deadline() -> None:
    wire = BusyWire()
    connection = IsoTpConnection(wire, 0x601, 0x581, lambda request, answer: True)
    connection.specific_send(b"\x22\x01\x02")

    def answers() -> set[bytes]:
        return {connection.specific_wait_frame(5.0) for _ in range(10 * round(ANSWER_LIMIT))}

    with pytest.raises(TimeoutException):
        answers()
    assert wire.seconds == pytest.approx(ANSWER_LIMIT, abs=3.0)


def test_node_that_is_busy_for_ever_is_asked_for_the_outcome_and_left() -> None:
    wire = BusyWire()
    with pytest.raises(
        LinkTimeout, match=r"in time: scan of .*its outcome it gave none\. `inkloop bench status SCENARIO`"
    ):
        Link(Node.PROFILER, CODEC, wire, "a wire").routine(Routine.SCAN, Key(JOB, 0), limit_s=60.0)
    assert 60.0 < wire.seconds < 75.0


@pytest.mark.parametrize(
    ("number", "message"),
    [(1, "no whole answer .* 6 tries: identifier 0103, map"), (2, "sent nothing whole in 6 tries: bl")],
)
def test_frames_that_come_damaged_are_not_called_nothing(number: int, message: str, bench: NodeBench) -> None:
    def spoil(frame: Frame) -> Frame:
        """The number of a consecutive frame."""
        is_it = frame.arbitration_id == 0x647 and frame.data[0] == 0x20 + number
        return frame._replace(data=bytes([frame.data[0] ^ 8]) + frame.data[1:]) if is_it else frame

    assert bench.scan(0) == 0
    with pytest.raises(LinkTimeout, match=message + r".*; \d+ of its frames came damaged, out of order or late: check"):
        FaultyWire(bench, PROFILER, alter=spoil).link().upload(0)


def test_node_that_restarts_in_the_middle_takes_the_pattern_after_a_clear(bench: NodeBench) -> None:
    blob = pattern_blob(np.ones((9, 8)))

    def restart(frame: Frame) -> Frame:
        bench.power_up(HEAD)
        bench.tick(100)
        return frame

    link = FaultyWire(bench, alter=nth(0, lambda frame: is_single(frame, EXIT), restart)).link()
    with pytest.raises(NodeRefused, match="clear"):
        link.download(1, blob)
    assert bench.clear() == 0
    link.download(1, blob)
    assert bench.state().pattern_crc == zlib.crc32(blob)


def test_node_that_does_not_answer_is_named_with_what_was_asked(bench: NodeBench) -> None:
    wire = FaultyWire(bench, alter=lambda frame: None if frame.arbitration_id == 0x641 else frame)
    began = wire.now()
    with pytest.raises(LinkTimeout, match=r"head \(0x641 on a faulty wire\) within 1 s, 6 tries: identifier 0100"):
        wire.link().state()
    assert 6 <= wire.now() - began < 7


def test_map_of_another_layer_is_refused_with_a_message(bench: NodeBench) -> None:
    link = FaultyWire(bench, PROFILER).link()
    with pytest.raises(NodeRefused, match="no map of layer 0"):
        link.upload(0)
    assert bench.scan(0) == 0
    with pytest.raises(NodeRefused, match=r"0x24.*expects another step or layer") as caught:
        link.upload(3)
    assert caught.value.code == 0x24
    assert link.counts.restarted == 0, "what is refused is not sent again"


def test_copy_at_the_heels_of_an_answer_is_counted_and_never_taken_for_the_next_one() -> None:
    connection = IsoTpConnection(PlainWire(), 0x640, 0x641, lambda request, message: message[1:] == request[1:])
    for number in range(3):
        connection.empty_rxqueue()
        connection.send(bytes([0x22, number]))
        assert connection.wait_frame(1.0) == bytes([0x62, number])
        assert connection.stray == number


def test_pause_ends_with_the_error_that_makes_waiting_useless() -> None:
    class Lost(StoppingWire):
        def check(self) -> None:
            if self.seconds >= 0.2:
                raise NodeLost("silent")

    wire = Lost(0)
    with pytest.raises(NodeLost, match="silent"):
        IsoTpConnection(wire, 0x640, 0x641, lambda *_: True).pause(9.0)
    assert 0.2 <= wire.seconds < 0.3


def test_damaged_and_late_frames_of_a_node_are_counted_together() -> None:
    requests = Requests(Node.PROFILER, CODEC, PlainWire(), "here")
    requests.connection.broken, requests.connection.stray = 2, 3
    assert requests.spoilt == 5
    assert requests.spoilt_frames(1).startswith("4 of its frames came damaged, out of order or late")
    assert requests.spoilt_frames(5) == ""


class OddProfiler:
    """Answers an upload with what no profiler of ours would: another size, blocks of its own."""

    name, spoilt = "profiler", 0
    client = SimpleNamespace(
        request_upload="upload", request_download="upload", transfer_data="block", request_transfer_exit="exit"
    )

    def __init__(self, size: tuple[int, int, int], most: int, blocks: list[bytes]) -> None:
        self.size, self.blocks, self.asked = MapSize(*size), iter(blocks), list[Any]()
        self.answers: dict[str, Callable[[], Any]] = {
            "upload": lambda: {"max_length": most},
            "block": lambda: {"parameter_records": next(self.blocks)},
            "exit": lambda: {"parameter_records": pack(">I", zlib.crc32(b"".join(blocks)))},
        }

    def read(self, *_: object) -> MapSize:
        return self.size

    def request(self, _what: str, service: str, *arguments: object, **__: object) -> Any:
        self.asked += [arguments] if service == "block" else []
        return SimpleNamespace(service_data=SimpleNamespace(**self.answers[service]()))


WHOLE = bytes(range(map_size(9, 8)))
ODD: dict[str, tuple[tuple[int, int, int], int, list[bytes]]] = {
    "165 bytes for its map of 9 x 9 cells": ((165, 9, 9), 66, [WHOLE]),
    f"bytes for its map of 2 x {CELLS_MAX} cells": ((map_size(2, CELLS_MAX), 2, CELLS_MAX), 66, [WHOLE]),
    "takes blocks of 2 bytes, expected more than 2": ((165, 9, 8), 2, [WHOLE]),
    "sent an empty block: block 2 of the map of layer 3": ((165, 9, 8), 66, [WHOLE[:64], b"", WHOLE[64:]]),
    "map of layer 3 from the profiler was altered": ((165, 9, 8), 66, [WHOLE[:64], WHOLE]),
}


@pytest.mark.parametrize("message", ODD)
def test_map_that_cannot_be_is_refused_with_a_message(message: str) -> None:
    with pytest.raises(TransferError, match=message):
        receive_map(OddProfiler(*ODD[message]), 3, None)  # type: ignore[arg-type]
    assert receive_map(OddProfiler((165, 9, 8), 66, [WHOLE[:64], WHOLE[64:]]), 3, None) == WHOLE  # type: ignore[arg-type]


def test_number_of_a_block_is_a_byte_and_progress_is_reported_after_each() -> None:
    """Blocks of one byte beside their head."""
    blob = bytes(number % 251 for number in range(map_size(16, 12)))
    total, expected = len(blob), [number % 256 for number in range(1, len(blob) + 1)]
    assert total > 256
    moved: list[tuple[int, int]] = []
    profiler: Any = OddProfiler((total, 16, 12), 3, [blob[at : at + 1] for at in range(total)])
    assert receive_map(profiler, 3, lambda done, of: moved.append((done, of))) == blob
    assert [number for number, _ in profiler.asked] == expected
    head: Any = OddProfiler((0, 0, 0), 3, [blob])
    head.answers["block"] = dict
    send_pattern(head, 3, blob, False, lambda done, of: moved.append((done, of)))
    assert head.asked == [(number, blob[at : at + 1]) for at, number in enumerate(expected)]
    assert moved == 2 * [(done, total) for done in range(1, total + 1)]


DIFFER = (0x24, 0x31, 0x71, 0x72, 0x73)


@pytest.mark.parametrize("code", [*DIFFER, 0x13, 0x21, 0x22])
@pytest.mark.parametrize("place", ["upload", "block", "exit"])
def test_transfer_is_begun_again_where_the_two_ends_differ_in_the_middle_of_it(place: str, code: int) -> None:
    def refuse() -> Any:
        raise NodeRefused("the node refuses", code)

    profiler: Any = OddProfiler((165, 9, 8), 66, [WHOLE[:64], WHOLE[64:]])
    profiler.answers[place] = refuse
    with pytest.raises(TransferError if code in DIFFER and place != "upload" else NodeRefused, match="refuses"):
        receive_map(profiler, 3, None)


@pytest.mark.parametrize(
    ("flags", "done", "sent"),
    [(1, 64, [1, 2, 3]), (0, 64, []), (1, 0, [1, 1, 2, 3]), (0, 0, []), (1, 32, [])],
    ids=["it has the block", "no transfer", "it has not the block", "begun again", "it has some of it"],
)
def test_block_without_an_answer_is_what_the_node_says_of_it(flags: int, done: int, sent: list[int]) -> None:
    """Blocks of 64 bytes; the rest follows only where both ends agree."""
    head: Any = OddProfiler((0, 0, 0), 66, [WHOLE])
    lost = iter([True])

    def block() -> dict[str, bytes]:
        if next(lost, False):
            raise LinkTimeout("no answer")
        return {}

    head.answers["block"] = block
    head.read = lambda *_: TransferState(TransferFlags(flags), 1, 3, JOB, done, len(WHOLE))
    if not sent:
        with pytest.raises(TransferError, match=f"has {done} bytes, expected 0: block 1 of the pattern of layer 3"):
            send_pattern(head, 3, WHOLE, False, None)
        return
    send_pattern(head, 3, WHOLE, False, None)
    assert [number for number, _ in head.asked] == sent


def test_pattern_of_which_the_node_has_another_checksum_is_not_there() -> None:
    head: Any = OddProfiler((0, 0, 0), 66, [WHOLE])
    head.answers["block"] = dict
    with pytest.raises(TransferError, match="has another checksum: end of the pattern of layer 3"):
        send_pattern(head, 3, WHOLE[::-1], False, None)


class Conditions:
    """Requests to a node in a state, which refuses a routine for its conditions so often; `log` has what was done."""

    client = SimpleNamespace(start_routine="start", get_routine_result="ask")

    def __init__(self, state: State, flags: Flags, refusals: int) -> None:
        self.state, self.left, self.repeated = node_state(state=state, flags=flags), refusals, 0
        self.log: list[Any] = []
        self.connection = SimpleNamespace(pause=self.log.append)
        self.answers: dict[str, Callable[[], int]] = {"start": lambda: Outcome.DONE}

    def request(self, _what: str, service: str, *_: object, limit_s: float) -> Any:
        self.log.append(service)
        self.left -= 1
        if self.left >= 0:
            raise NodeRefused("the head refuses", 0x22)
        return SimpleNamespace(service_data=SimpleNamespace(routine_status_record=bytes([self.answers[service]()])))

    def read(self, *_: object) -> Any:
        return self.state

    def decoded(self, _what: str, data: bytes, of: Callable[[bytes], Any]) -> Any:
        return of(data)


def link_with(requests: Conditions) -> Link:
    link: Any = Link(Node.HEAD, CODEC, PlainWire(), "a wire")
    link.requests = requests
    return link


@pytest.mark.parametrize(
    ("routine", "state", "flags", "again"),
    [
        (Routine.CLEAR, State.SAFE, Flags(0), True),
        (Routine.CLEAR, State.FAULT, Flags.DRY_RUN, True),
        (Routine.CLEAR, State.SAFE, Flags.NEEDS_OPERATOR, False),
        (Routine.CLEAR, State.SAFE, Flags.STOPPED, False),
        (Routine.PASS, State.VERIFIED, Flags(0), True),
        (Routine.HOME, State.IDLE, Flags.NEEDS_OPERATOR, True),
        (Routine.PASS, State.SAFE, Flags(0), False),
        (Routine.HOME, State.FAULT, Flags(0), False),
    ],
)
def test_routine_is_asked_for_again_once_where_the_next_heartbeat_may_allow_it(
    routine: Routine, state: State, flags: Flags, again: bool
) -> None:
    """The frame that enabled it may have been lost: the next one comes within 100 ms."""
    requests = Conditions(state, flags, 1)
    link = link_with(requests)
    if again:
        assert link.routine(routine, Key(JOB, 1), limit_s=9.0) is Outcome.DONE
        assert (requests.log, requests.repeated) == (["start", 0.15, "start"], 1)
    else:
        with pytest.raises(NodeRefused, match=f"refuses; it is {state.name}"):
            link.routine(routine, Key(JOB, 1), limit_s=9.0)
        assert (requests.log, requests.repeated) == (["start"], 0)
    with pytest.raises(NodeRefused):
        link_with(Conditions(state, flags, 2)).routine(routine, Key(JOB, 1), limit_s=9.0)


@pytest.mark.parametrize(
    ("outcome", "words"),
    [
        (Outcome.DONE, ""),
        (Outcome.DONE_BEFORE, ""),
        (Outcome.UNDER_WAY, "it answered: still under way"),
        (Outcome.UNKNOWN, "it answered: begun, and its progress is unknown"),
        (Outcome.NEVER, "it answered: never begun"),
    ],
)
def test_routine_whose_time_is_over_is_what_the_node_says_of_it(outcome: Outcome, words: str) -> None:
    def late() -> int:
        raise DeadlinePassed("not in time")

    requests = Conditions(State.IDLE, Flags(0), 0)
    requests.answers = {"start": late, "ask": lambda: outcome}
    if words:
        with pytest.raises(LinkTimeout, match=f"^not in time; asked for its outcome {words}"):
            link_with(requests).routine(Routine.PASS, Key(JOB, 1), limit_s=9.0)
    else:
        assert link_with(requests).routine(Routine.PASS, Key(JOB, 1), limit_s=9.0) is outcome
    assert requests.log == ["start", "ask"]


class StoppingWire(PlainWire):
    """A node whose answers stop after their first frame, or after one or two more, as the second was lost. A wait takes
    its time; `given_up` counts the answers that were refused."""

    def __init__(self, more: int) -> None:
        super().__init__()
        self.more, self.given_up = more, 0

    def send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if kind(frame) == 0:
                self.coming.append(bytes([0x10, 33, frame.data[1] + 0x40, *frame.data[2:4], 0, 0, 0]))
            elif frame.data[0] == 0x30:
                self.coming.extend(bytes([0x22 + number, *bytes(7)]) for number in range(self.more))
            self.given_up += frame.data[0] == 0x32

    def receive(self, wait_s: float) -> bytes | None:
        if not self.coming:
            self.seconds += wait_s
        return super().receive(wait_s)


@pytest.mark.parametrize(
    ("answer_s", "more", "quiet_s"), [(1.0, 0, 0.25), (4.0, 0, 1.0), (4.0, 1, 0.05), (4.0, 2, 0.05)]
)
def test_answer_that_stops_is_refused_and_asked_for_again_soon(answer_s: float, more: int, quiet_s: float) -> None:
    """After a quarter of the time to begin one, or at once where a frame is known to be lost; six times in all."""
    wire, spoilt = StoppingWire(more), 6 * max(1, more)
    link = Link(Node.HEAD, CODEC, wire, "a wire", answer_s=answer_s)
    with pytest.raises(
        LinkTimeout, match=rf"no whole answer .* within {answer_s:g} s, 6 tries: .*; {spoilt} of its frames"
    ):
        link.state()
    assert 6 * quiet_s < wire.seconds < 6 * (quiet_s + 0.11)
    assert (wire.given_up, link.counts.broken, link.counts.repeated) == (6, spoilt, 6)


@pytest.mark.parametrize(("answer_s", "busy_s"), [(1.0, 5.0), (8.0, 8.0)])
def test_node_that_is_busy_has_five_seconds_at_least(answer_s: float, busy_s: float) -> None:
    config = Requests(Node.HEAD, CODEC, PlainWire(), "here", answer_s=answer_s).client.config
    assert (config["p2_timeout"], config["p2_star_timeout"]) == (answer_s, busy_s)

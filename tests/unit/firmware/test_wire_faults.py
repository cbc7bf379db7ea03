"""The wire of the emulator: frames that faults hit, and the effects on them."""

from __future__ import annotations

import ctypes
from collections import Counter
from functools import cache

import pytest

from inkloop.tables.bench_faults import FaultTable, read_fault
from inkloop_hardware.bus.slcan_bus import frame_of
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, pack
from support.benches.node_bench import CORE, FAULTS, HOST, KERNELS, WIRE, Broken, codec, firmware_library
from support.places import C_SOURCES

TO_NODES, FROM_NODES = 0, 1
CODEC = Codec()


class Taken(ctypes.Structure):
    _fields_ = (
        ("id", ctypes.c_uint32),
        ("length", ctypes.c_uint8),
        ("data", ctypes.c_uint8 * 8),
        ("is_line", ctypes.c_uint8),
        ("line_length", ctypes.c_uint8),
        ("line", ctypes.c_char * 80),
    )


@cache
def library() -> ctypes.CDLL:
    own = [codec() / "inkloop.c", C_SOURCES / "fault_probe.c"]
    sources = [*CORE, *HOST, *KERNELS, *FAULTS, *WIRE, *own]
    loaded = firmware_library("wire_faults.so", sources)
    loaded.probe_taken.restype = ctypes.POINTER(Taken)
    return loaded


class FaultyWire:
    def __init__(self, *faults: str) -> None:
        self.c = library()
        self.c.probe_begin()
        why = ctypes.create_string_buffer(300)
        for fault in faults:
            assert self.c.probe_add(fault.encode(), why, 300), why.value

    def send(self, frame: Frame, way: int = TO_NODES) -> None:
        self.c.probe_pass(way, ctypes.c_uint32(frame.arbitration_id), frame.data, ctypes.c_uint8(len(frame.data)))

    def taken(self) -> list[Frame | bytes]:
        """Output: frames, and lines in place of frames."""
        found: list[Frame | bytes] = []
        for k in range(self.c.probe_count()):
            one = self.c.probe_taken(k).contents
            line = ctypes.string_at(ctypes.addressof(one) + Taken.line.offset, one.line_length)
            found.append(line if one.is_line else Frame(one.id, bytes(one.data[: one.length])))
        return found


def numbered(count: int, identifier: int = 0x640) -> list[Frame]:
    return [Frame(identifier, number.to_bytes(4, "big")) for number in range(count)]


def through(*faults: str, count: int = 200, identifier: int = 0x640, way: int = TO_NODES) -> list[int]:
    """Numbers of the frames that came out."""
    wire = FaultyWire(*faults)
    for frame in numbered(count, identifier):
        wire.send(frame, way)
    return [int.from_bytes(frame.data, "big") for frame in wire.taken() if isinstance(frame, Frame)]


def test_same_seed_loses_the_same_frames_and_another_one_others() -> None:
    first, again, other = (through(f"loss:probability=0.1,seed={seed}") for seed in (1, 1, 2))
    assert first == again != other
    assert 150 < len(first) < 200


def test_frames_of_an_id_are_hit_whatever_comes_between_them() -> None:
    alone = through("loss:probability=0.1", count=100)
    wire = FaultyWire("loss:probability=0.1")
    for number, frame in enumerate(numbered(100)):
        wire.send(frame)
        for _ in range(number % 3):
            wire.send(Frame(0x101, bytes(8)), FROM_NODES)
    found = [frame for frame in wire.taken() if isinstance(frame, Frame) and frame.arbitration_id == 0x640]
    assert [int.from_bytes(frame.data, "big") for frame in found] == alone


def test_probability_is_the_share_of_frames() -> None:
    wire = FaultyWire("loss:probability=0.25,seed=3")
    for frame in numbered(4000):
        wire.send(frame)
    assert 4000 * 0.75 - 3 * 27.4 < len(wire.taken()) < 4000 * 0.75 + 3 * 27.4  # three standard deviations


def test_single_shot_hits_the_nth_that_fits_and_as_many_after_it() -> None:
    assert through("loss:nth=5,count=3", count=10) == [0, 1, 2, 3, 7, 8, 9]
    assert through("burst:nth=2", count=20) == [0, 17, 18, 19]
    assert through("loss", count=3) == [1, 2]


def test_only_what_fits_is_counted_and_hit() -> None:
    for fault in ("loss:id=0x641", "loss:way=from-nodes", "loss:node=cure", "flow-control", "stuck-counter"):
        assert through(fault, count=5) == [0, 1, 2, 3, 4], fault
    assert through("loss:way=from-nodes,node=head", count=2, identifier=0x641, way=FROM_NODES) == [1]
    for identifier, node in ((0x103, "cure"), (0x114, "profiler"), (0x182, "stage"), (0x642, "stage")):
        assert through(f"loss:node={node}", count=2, identifier=identifier) == [1]


def test_fault_that_waits_for_a_step_does_nothing_before() -> None:
    assert through("loss:step=pass,count=100", count=5) == [0, 1, 2, 3, 4]


def test_frames_are_doubled_swapped_and_overtaken() -> None:
    assert through("duplication:nth=2", count=3) == [0, 1, 1, 2]
    assert through("swap:nth=2", count=4) == [0, 2, 1, 3]
    assert through("delay:nth=1,frames=3", count=6) == [1, 2, 3, 0, 4, 5]
    assert Counter(through("swap:probability=0.3,seed=5", count=200)).most_common(1)[0][1] == 1


def test_frames_of_one_id_leave_a_node_out_of_order() -> None:
    wire = FaultyWire("transmit-order:id=0x641,nth=2")
    for number, frame in enumerate(numbered(4, 0x641)):
        wire.send(frame, FROM_NODES)
        wire.send(Frame(0x101, bytes([number])), FROM_NODES)
    found = [frame for frame in wire.taken() if isinstance(frame, Frame)]
    assert [frame.data[-1] for frame in found if frame.arbitration_id == 0x641] == [0, 2, 1, 3]
    assert [frame.data[-1] for frame in found if frame.arbitration_id == 0x101] == [0, 1, 2, 3]
    assert through("transmit-order", count=3) == [0, 1, 2], "masters send in order"
    alone = FaultyWire("transmit-order")
    alone.send(Frame(0x101, bytes(8)), FROM_NODES)
    assert not alone.taken()
    alone.c.probe_settle()
    assert len(alone.taken()) == 1, "in the same turn of its node"


def test_short_queue_holds_the_first_frames_of_each_block() -> None:
    wire = FaultyWire("short-queue:node=head,frames=3")
    wire.send(Frame(0x640, b"\x11\x2c"))
    for block in range(2):
        for number in range(16):
            wire.send(Frame(0x640, bytes([0x20 + (number + 1) % 16, block])))
            wire.send(Frame(0x646, bytes([0x20 + (number + 1) % 16])))
        wire.send(Frame(0x641, b"\x30\x10\x00"), FROM_NODES)
    found = [frame for frame in wire.taken() if isinstance(frame, Frame)]
    assert [frame.data for frame in found if frame.arbitration_id == 0x640] == [
        b"\x11\x2c", b"\x21\0", b"\x22\0", b"\x23\0", b"\x21\1", b"\x22\1", b"\x23\1"
    ]  # fmt: skip
    assert len([frame for frame in found if frame.arbitration_id == 0x646]) == 32, "another node"


def test_node_keeps_32_frames_of_its_own_until_its_next_turn() -> None:
    """A block of 16 and what comes during an erasure of 300 ms; frames of others need no room."""
    overruns = library().probe_overruns
    assert [overruns(0x640, number) for number in (16, 32, 33, 40)] == [0, 0, 1, 8]
    assert [overruns(identifier, 40) for identifier in (0x10, 0x20, 0x642, 0x101)] == [8, 8, 0, 0]


def test_a_frame_meets_every_fault_in_turn_and_each_of_them_once() -> None:
    assert through("duplication:nth=2", "loss:nth=3", count=4) == [0, 1, 2, 3]
    assert through("loss:nth=5", "swap:nth=2", count=7) == [0, 2, 1, 3, 5, 6]


def test_burst_that_begins_within_another_one_does_not_lengthen_it() -> None:
    """Each of them has so many frames in a row; with every frame hit they follow one another."""
    begins = set(range(200)) - set(through("loss:probability=0.1,seed=1", count=200))
    lost = set(range(200)) - set(through("loss:probability=0.1,seed=1,count=5", count=200))
    expected, left = set[int](), 0
    for number in range(200):
        left = 5 if number in begins and left == 0 else left
        expected |= {number} if left else set()
        left = max(0, left - 1)
    assert lost == expected


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("loss:probability=0.1,nth=3", "give probability or nth, not both"),
        ("loss:probability=1.5", "the key does not take this value"),
        ("loss:probability=0", "the key does not take this value"),
        ("loss:service=0xC0", "the key does not take this value"),
        ("loss:byte=8", "the key does not take this value"),
        ("loss:id=0x800", "the key does not take this value"),
        ("loss:pass=4", "the key does not take this value"),
        ("loss:nth=0", "the key does not take this value"),
        ("loss:colour=1", "there is no such key"),
        ("hang", "it needs node=head, stage, cure or profiler"),
        ("slow-erase", "it needs node=head, stage, cure or profiler"),
        ("unreadable:count=3", "it needs node=head, stage, cure or profiler"),
        ("broken", "it needs part=gate-stays-open"),
        ("lost", "no fault is called lost"),
    ],
)
def test_fault_that_cannot_be_is_refused_by_the_nodes_too(text: str, why: str) -> None:
    """Whoever starts them without `inkloop bench emulate`."""
    wire, found = FaultyWire(), ctypes.create_string_buffer(300)
    assert not wire.c.probe_add(text.encode(), found, 300)
    assert why in found.value.decode()


def test_corruption_turns_one_bit() -> None:
    wire = FaultyWire("corruption:probability=1,seed=4")
    for _ in range(100):
        wire.send(Frame(0x640, bytes(8)))
    turned = [int.from_bytes(frame.data, "big") for frame in wire.taken() if isinstance(frame, Frame)]
    assert all(number.bit_count() == 1 for number in turned)
    assert len(set(turned)) > 30
    wire = FaultyWire("corruption:byte=6")
    wire.send(Frame(0x640, bytes(8)))
    (found,) = wire.taken()
    assert isinstance(found, Frame)
    assert found.data[6] != 0


def test_stuck_counter_has_a_check_byte_that_is_right_and_a_bad_check_byte_has_not() -> None:
    alive = MasterAlive(True, False, False, session=5, job=6)
    wire = FaultyWire("stuck-counter:nth=2,count=2", "bad-check:nth=4,count=1")
    for counter in range(5):
        wire.send(pack(CODEC, alive, counter))
    readings = [CODEC.decode(frame) for frame in wire.taken() if isinstance(frame, Frame)]
    assert [reading.intact for reading in readings] == [True, True, True, False, True]
    assert [reading.counter for reading in readings[:3]] == [0, 0, 0]


def test_garbled_line_is_no_frame() -> None:
    wire = FaultyWire("malformed-line:probability=1")
    for number in range(60):
        wire.send(Frame(0x101, bytes(range(number % 9))), FROM_NODES)
    lines = wire.taken()
    assert len(set(lines)) > 10
    for line in lines:
        assert isinstance(line, bytes)
        assert line.endswith(b"\r")
        for part in line.split(b"\r")[:-1]:
            with pytest.raises((ValueError, IndexError)):
                frame_of(part, 0.0)


def test_malformed_line_to_the_nodes_is_a_lost_frame() -> None:
    assert through("malformed-line:nth=2", count=3) == [0, 2]


@pytest.mark.parametrize("kind", FaultTable.model_fields["kind"].annotation.__args__)
def test_every_kind_and_key_of_a_scenario_is_known_to_the_nodes(kind: str) -> None:
    FaultyWire(
        str(
            read_fault(
                f"{kind}:node=head,nth=2,count=3,frames=4,id=0x20,seed=5,layer=1,pass=2,step=upload,part=not-ready"
            )
        )
    )
    FaultyWire(
        str(
            read_fault(
                f"{kind}:node=cure,probability=1e-3,way=to-nodes,service=0x36,byte=7,step=self-test,part=not-ready"
            )
        )
    )


def test_parts_that_break_one_after_the_other_are_all_broken() -> None:
    wire = FaultyWire("broken:part=lamp-stays-on", "broken:part=not-ready", "broken:part=end-switches")
    assert (
        wire.c.probe_broken()
        == Broken.LAMP_STAYS_ON | Broken.NOT_READY | Broken.GATE_STAYS_OPEN | Broken.GATE_STAYS_CLOSED
    )


def armed(fault: str, step: int, layer: int = 0, number: int = 0, transfer: int = 0) -> bool:
    return bool(FaultyWire(fault).c.probe_arms(step, layer, number, transfer))


PASS, CURE, DOWNLOAD, UPLOAD = 4, 5, 1, 2


def test_fault_is_armed_by_the_step_layer_and_pass_that_it_names() -> None:
    assert armed("loss", 0), "one that names none is armed from the start"
    for fault, step in (("loss:step=pass", PASS), ("loss:step=cure", CURE)):
        assert [armed(fault, kind) for kind in (0, PASS, CURE)] == [kind == step for kind in (0, PASS, CURE)]
    for fault in ("loss:layer=2", "loss:step=cure,layer=2", "loss:layer=2,pass=1", "loss:step=cure,layer=2,pass=1"):
        assert armed(fault, CURE, 2, 1)
        assert not armed(fault, CURE, 3, 1)
        assert not armed(fault, 0, 2, 1)
    assert [armed("loss:pass=1", CURE, 2, number) for number in (0, 1, 2)] == [False, True, False]


def test_fault_is_armed_by_a_transfer_of_its_layer_unless_it_names_a_pass() -> None:
    ways = (0, DOWNLOAD, UPLOAD)
    assert [armed("loss:step=download", 0, 2, transfer=way) for way in ways] == [False, True, False]
    assert [armed("loss:step=upload", 0, 2, transfer=way) for way in ways] == [False, False, True]
    assert [armed("loss:layer=2", 0, 2, transfer=way) for way in ways] == [False, True, True]
    assert not any(armed("loss:layer=3", 0, 2, transfer=way) for way in ways)
    assert not any(armed("loss:pass=0", 0, 2, transfer=way) for way in ways)
    assert not any(armed("loss:step=cure", 0, 2, transfer=way) for way in ways)


def test_armed_fault_stays_so() -> None:
    wire = FaultyWire("loss:step=pass")
    assert [wire.c.probe_arms(kind, 1, 0, 0) for kind in (0, PASS, 0)] == [0, 1, 1]


@pytest.mark.parametrize(
    ("fault", "hit"),
    [
        ("late-answer", [True, False, False]),
        ("late-answer:count=3", [True, True, True]),
        ("late-answer:service=0x36", [False, False, True]),
        ("late-answer:service=0x31", [True, False, False]),
        ("late-answer:service=0x31,count=2", [True, True, False]),
        ("late-answer:nth=2", [False, True, False]),
        ("late-answer:service=0xBF", [False, False, False]),
        ("late-answer:node=cure", [True, False, False]),
        ("late-answer:node=head,count=3", [False, False, False]),
    ],
)
def test_answer_belongs_to_its_service_also_if_it_refuses(fault: str, hit: list[bool]) -> None:
    wire, cure = FaultyWire(fault), 2
    answers = (b"\x71\x01\x02", b"\x7f\x31\x22", b"\x76\x01")
    assert [bool(wire.c.probe_hits_answer(cure, answer, len(answer))) for answer in answers] == hit


@pytest.mark.parametrize(
    ("fault", "frames", "happens"),
    [
        ("second-master", (-1, -1), [True, False]),
        ("second-master", (0x20, 0x640), [False, False]),
        ("second-master:nth=2", (-1, 0x20, 0x640, 0x20), [False, False, True, False]),
        ("second-master:nth=2,id=0x20", (0x20, 0x640, 0x20, 0x20), [False, False, True, False]),
        ("second-master:probability=1", (-1, 0x20, 0x640), [False, True, True]),
        ("second-master:step=pass", (-1, -1), [False, False]),
        ("loss", (-1, 0x20), [False, False]),
    ],
)
def test_event_happens_once_at_once_or_with_the_frame_that_it_names(
    fault: str, frames: tuple[int, ...], happens: list[bool]
) -> None:
    wire = FaultyWire(fault)
    assert [bool(wire.c.probe_happens(frame)) for frame in frames] == happens


def test_faults_of_one_seed_hit_frames_of_their_own() -> None:
    """Which are altered says nothing of which are doubled."""
    wire, frames = FaultyWire("corruption:probability=0.3,byte=7", "duplication:probability=0.3"), 200
    for number in range(frames):
        wire.send(Frame(0x640, number.to_bytes(4, "big") + bytes(4)))
    found = Counter(frame.data for frame in wire.taken() if isinstance(frame, Frame))
    altered = {data[3] for data in found if data[7]}
    doubled = {data[3] for data, count in found.items() if count == 2}
    assert 0.2 * frames < len(altered) < 0.4 * frames
    assert 0.2 * frames < len(doubled) < 0.4 * frames
    assert len(altered & doubled) < 0.5 * len(doubled)


def test_frames_of_two_masters_are_held_each_by_its_own_counter_and_way() -> None:
    """The last frame with another id, or the other way, does not count."""
    wire = FaultyWire("stuck-counter:id=0x20,nth=2,count=1")
    other = CODEC.encode("StopRequest", {"Active": 0, "Source": 0}, 9)
    for counter in (3, 4):
        wire.send(pack(CODEC, MasterAlive(False, False, False, 5, 6), counter))
        wire.send(other)
    readings = [CODEC.decode(frame) for frame in wire.taken() if isinstance(frame, Frame)]
    assert [reading.counter for reading in readings] == [3, 9, 3, 9]
    held = FaultyWire("delay:way=to-nodes,frames=1")
    held.send(Frame(0x640, b"1"))
    held.send(Frame(0x641, b"2"), FROM_NODES)
    held.send(Frame(0x640, b"3"))
    held.send(Frame(0x640, b"4"))
    assert [frame.data for frame in held.taken() if isinstance(frame, Frame)] == [b"2", b"3", b"1", b"4"]


def test_delay_of_a_frame_is_ten_others_unless_it_is_said() -> None:
    assert through("delay", count=13) == [*range(1, 11), 0, 11, 12]
    assert through("loss:pass=0", count=3) == [0, 1, 2], "no pass yet"


def test_supervised_frame_is_stuck_or_bad_ten_times_unless_it_is_said() -> None:
    wire = FaultyWire("bad-check")
    for counter in range(13):
        wire.send(pack(CODEC, MasterAlive(False, False, False, 5, 6), counter))
    readings = [CODEC.decode(frame) for frame in wire.taken() if isinstance(frame, Frame)]
    assert [reading.intact for reading in readings] == 10 * [False] + 3 * [True]


def test_corrupted_byte_is_that_of_the_frame_however_short_and_another_bit_each_time() -> None:
    wire = FaultyWire("corruption:byte=7,count=40,seed=2")
    for _ in range(40):
        wire.send(Frame(0x640, bytes(3)))
    frames = [frame.data for frame in wire.taken() if isinstance(frame, Frame)]
    assert {data[:1] + data[2:] for data in frames} == {b"\0\0"}, "byte 7 of 3 is byte 1"
    assert len({data[1] for data in frames}) > 4

"""A rig that a file maps: what goes to its bus, what is waited for, and what a step makes of it; no bus is there."""

from __future__ import annotations

import itertools
import struct
import zlib
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from e2e import p01

from inkloop.errors import ComponentError
from inkloop.testing import job as small_job
from inkloop_hardware.bus.adapter import message_of
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.master_journal import Asked, Event, MasterJournal
from inkloop_hardware.doctor import status as bench_status
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.status import judge_rig
from inkloop_hardware.errors import BusError, HardwareError, LinkTimeout, TransferError
from inkloop_hardware.mapped import mapped_bus
from inkloop_hardware.mapped.mapped import Mapped
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_layer import MappedSteps, stop_rig
from inkloop_hardware.mapped.mapping_file import load
from inkloop_hardware.mapped.mapping_tables import Read, RoutineStep, Send, Wait
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.services import Key
from support.benches import foreign_rig

JOB = small_job(6, 5)
IDLE, BUSY, READY, FAULT = range(4)


class Clock:
    """Runs only while somebody sleeps; `after` are frames that come with a sleep, one each."""

    def __init__(self) -> None:
        self.now, self.after = 100.0, deque[Frame]()
        self.bus: Any = None

    def second(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds
        if self.after:
            self.bus.others.append((self.now, self.after.popleft()))


class Connection:
    """Stands for a BusConnection; `log` has what went out."""

    def __init__(self, settings: BusSettings, session: int, job: int, answers: Any) -> None:
        self.made = settings, session, job, list(answers)
        self.others: deque[tuple[float, Frame]] = deque()
        self.log: list[Any] = []
        self.at_once: list[Frame] = []  # what comes before anybody waits
        self.receive = Mock(return_value=b"data")
        self.check, self.close = Mock(), Mock()

    def send(self, frames: Any) -> None:
        self.log += frames
        self.others.extend((0.0, frame) for frame in self.at_once)

    def send_keep_alive(self, enables: Enables) -> None:
        self.log.append(enables)


def state(code: int, layers: int = 0, bed_mm: float = 0.0, celsius: float = 0.0) -> Frame:
    """A frame PlcState as its DBC lays it out."""
    return Frame(544, struct.pack("<BHHhx", code, layers, round(bed_mm * 100), round(celsius * 10)))


ANY_BED: dict[str, Any] = {"is_open": False, "valid_share": 0.0, "on_part": True}
"""Of a rig that does not look at its first scan."""


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    for name, value in {"now": found.second, "sleep": found.sleep}.items():
        monkeypatch.setattr(Connection, name, value, raising=False)
    monkeypatch.setattr(mapped_bus, "connected", Connection)
    monkeypatch.setattr(mapped_bus, "lock_channel", lambda settings: lambda: None)  # tests share a channel
    return found


def written(folder: Path, old: str = "", new: str = "") -> Path:
    (folder / "rig.dbc").write_text(foreign_rig.DBC)
    (folder / "rig.toml").write_text(foreign_rig.MAPPING.replace(old, new) if old else foreign_rig.MAPPING)
    return folder / "rig.toml"


def opened(folder: Path, clock: Clock, heartbeat: bool = True, **settings: Any) -> tuple[MappedBus, Connection]:
    mapping = load(written(folder), JOB)
    mapping.tables.__dict__["heartbeat"] = heartbeat
    bus = MappedBus(BusSettings(**settings), folder, mapping, 5, 7)
    clock.bus = bus._bus
    return bus, clock.bus


def test_bus_is_opened_with_the_answers_of_the_peers_and_its_log_in_the_folder(tmp_path: Path, clock: Clock) -> None:
    _, bus = opened(tmp_path, clock, traffic_log=Path("bus.asc"))
    settings, session, job, answers = bus.made
    assert settings.traffic_log == tmp_path / "bus.asc"
    assert (session, job, answers) == (5, 7, [0x7A8, 0x7B8])
    assert not settings.fd
    assert opened(tmp_path, clock, fd=True)[1].made[0].fd
    assert opened(tmp_path, clock)[1].made[0].traffic_log is None


def test_heartbeat_is_kept_alive_every_20_ms_if_the_mapping_has_one(tmp_path: Path, clock: Clock) -> None:
    bus, wire = opened(tmp_path, clock)
    for _ in range(10):
        bus.take()
        clock.now += 0.006
    assert wire.log == [Enables.NONE] * 3
    silent, wire = opened(tmp_path, clock, heartbeat=False)
    silent.take()
    assert wire.log == []
    assert wire.check.call_count == 1


def test_outputs_are_enabled_for_one_step_also_one_that_fails(tmp_path: Path, clock: Clock) -> None:
    bus, wire = opened(tmp_path, clock)
    with bus.enabled(["lamp", "motion"]):
        assert wire.log == [Enables.LAMP | Enables.MOTION]
        bus.take()
        assert wire.log[-1] == Enables.LAMP | Enables.MOTION
    assert wire.log[-1] == Enables.NONE
    with pytest.raises(KeyError), bus.enabled(["gate"]):
        raise KeyError
    assert wire.log[-2:] == [Enables.GATE, Enables.NONE]
    count = len(wire.log)
    with bus.enabled([]):
        pass
    assert len(wire.log) == count


def test_newest_frame_is_kept_and_what_is_no_message_of_the_file_is_left_out(tmp_path: Path, clock: Clock) -> None:
    bus, wire = opened(tmp_path, clock)
    frames = (state(BUSY, 3), Frame(0x123, bytes(8)), state(READY, 4, 12.5, -3.5), Frame(544, b"\1"))
    wire.others.extend((0.0, frame) for frame in frames)
    bus.take()
    assert list(bus.readings) == ["PlcState"]
    assert bus.readings["PlcState"].values == pytest.approx(
        {"State": 2, "LayersDone": 4, "BedPosition": 12.5, "Temperature": -3.5}, rel=1e-9, abs=0.0
    )
    assert [reading.values["LayersDone"] for reading in bus.inbox["PlcState"]] == [3, 4]
    wire.others.append((0.0, state(BUSY, 4)))
    bus.forget()
    bus.take()
    assert not bus.inbox, "what has come by then is forgotten, too"
    assert bus.readings["PlcState"].values["LayersDone"] == 4


def test_frame_with_a_wrong_check_byte_is_no_reading(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    supervised = 'BA_DEF_ BO_ "E2EDataId" INT 0 65535;\nBA_DEF_DEF_ "E2EDataId" 0;\nBA_ "E2EDataId" BO_ 544 5;\n'
    monkeypatch.setattr(foreign_rig, "DBC", foreign_rig.DBC + supervised)
    bus, wire = opened(tmp_path, clock)
    good = bytearray(state(READY, 4).data)
    p01.e2e_p01_protect(good, 5, increment_counter=False)
    wire.others.append((0.0, Frame(544, bytes([good[0] ^ 1, *good[1:]]))))
    bus.take()
    assert not bus.readings
    assert not bus.inbox
    with pytest.raises(LinkTimeout, match=r"; its frames were dropped: the check byte of 0x220 .* is wrong; has it"):
        bus.wait("PlcState", "State", "READY", 1.0)
    wire.others.append((0.0, Frame(544, bytes(good))))
    bus.take()
    assert list(bus.readings) == ["PlcState"]


@pytest.mark.parametrize(
    ("signal", "expected", "frame"),
    [
        ("State", "READY", state(READY)),
        ("State", 2, state(READY)),
        ("LayersDone", 7, state(IDLE, 7)),
        ("BedPosition", 12.34, state(IDLE, 0, 12.34)),
    ],
)
def test_wait_ends_with_the_first_frame_that_has_the_value(
    signal: str, expected: Any, frame: Frame, tmp_path: Path, clock: Clock
) -> None:
    bus, wire = opened(tmp_path, clock)
    wire.others.append((0.0, state(BUSY, 6, 12.33)))
    clock.after.extend([state(BUSY, 6, 12.35), frame, state(FAULT, 9)])
    bus.wait("PlcState", signal, expected, 10.0, "FAULT" if signal == "State" else None)
    assert clock.now == pytest.approx(100.01, rel=1e-9, abs=0.0)
    assert not bus.inbox["PlcState"]


def test_frames_after_the_one_that_is_waited_for_stay_for_the_next_wait(tmp_path: Path, clock: Clock) -> None:
    bus, wire = opened(tmp_path, clock)
    wire.others.extend((0.0, frame) for frame in (state(IDLE), state(BUSY), state(READY, 1)))
    bus.wait("PlcState", "State", "BUSY", 1.0)
    bus.wait("PlcState", "LayersDone", 1, 1.0)
    assert clock.now == 100.0


def test_value_that_does_not_come_is_reported_with_the_last_one_or_why_there_is_none(
    tmp_path: Path, clock: Clock
) -> None:
    bus, wire = opened(tmp_path, clock)

    def missed(message: str, signal: str, expected: Any, *frames: Frame, unless: Any = None) -> float:
        """Seconds until the wait for it ends, with this message."""
        wire.others.extend((0.0, frame) for frame in frames)
        began = clock.now
        with pytest.raises(HardwareError, match=message):
            bus.wait("PlcState", signal, expected, 2.5, unless)
        return clock.now - began

    waited = missed(r"was not READY within 2\.5 s; no frame of it was received$", "State", "READY")
    assert waited == pytest.approx(2.5, rel=0.0, abs=0.006)
    assert (
        missed(r"State is FAULT, expected READY; check the rig$", "State", "READY", state(FAULT), unless="FAULT") == 0
    )
    missed(r"^PlcState\.State was not READY within 2.5 s; it is BUSY$", "State", "READY", state(BUSY, 3))
    missed(r"^PlcState\.LayersDone was not 4 within 2.5 s; it is 3$", "LayersDone", 4)
    hot = state(READY, 3, 0.0, 160.0)
    missed(r"; its value was dropped: .*Temperature is 160 degC, expected -50 to", "Temperature", 20.0, hot)
    assert bus.readings["PlcState"].values["LayersDone"] == 3
    bus.readings.clear()
    short = (Frame(544, b"\2"), Frame(544, b"\2\3"))
    missed(r"; its frames were dropped: .* has 2 bytes, expected 8$", "State", "READY", *short)


def examined(folder: Path, *frames: Frame, silence_s: float = 0.3) -> dict[Grade, list[str]]:
    """Findings about the frames that the mapping waits for, when these come on its bus."""
    of_rig = iter([[message_of(frame) for frame in frames]])
    adapter: Any = SimpleNamespace(
        settings=BusSettings("virtual", "rig", silence_s=silence_s),
        receive=lambda wait_s: next(of_rig, []),
        complaints=dict[str, int],
        now=itertools.count(0.0, 0.25).__next__,
    )
    found: dict[Grade, list[str]] = {}
    for finding in judge_rig(adapter, load(written(folder), JOB)):
        if finding.check == "frames":
            found.setdefault(finding.grade, []).append(f"{finding.found}; {finding.advice}")
    return found


def test_doctor_looks_for_every_frame_that_the_mapping_waits_for(tmp_path: Path) -> None:
    (missing,) = examined(tmp_path, Frame(545, bytes(8)))[Grade.ERROR]
    assert missing.startswith("PlcState (0x220): none came in 1.")
    assert "printer step 3 and printer step 4 and outputs.bed_position waits for it: is the rig powered" in missing
    (short,) = examined(tmp_path, Frame(544, b"\2\3"))[Grade.ERROR]
    assert "1 in 1.5 s, but its frames were dropped: frame 0x220 [2] 02 03 of PlcState has 2 bytes" in short
    (there,) = examined(tmp_path, state(BUSY), state(READY, 4, 12.5))[Grade.OK]
    assert there.endswith("2 in 1.5 s; State: it is READY, LayersDone: it is 4, BedPosition: it is 12.5; ")
    (missing,) = examined(tmp_path, silence_s=1.5)[Grade.ERROR]
    assert missing.startswith("PlcState (0x220): none came in 3."), "two silences"


def test_doctor_warns_of_a_value_beyond_its_limits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(foreign_rig, "DBC", foreign_rig.DBC.replace("[0|655.35]", "[0|100]"))
    (found,) = examined(tmp_path, state(READY, 4, 100.5))[Grade.WARNING]
    assert "State: it is READY, LayersDone: it is 4, BedPosition: its value was dropped: " in found
    assert found.endswith("; compare limits and value tables with the rig")


def test_status_of_a_rig_is_a_line_for_each_finding_with_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    adapter = Mock()
    findings = [Finding.ok("bus", "a"), Finding.warning("frames", "b", "c"), Finding.error("frames", "d", "e")]
    monkeypatch.setattr(bench_status, "Adapter", adapter)
    monkeypatch.setattr(bench_status, "judge_rig", lambda adapter, mapping: iter(findings))
    mapping = load(written(tmp_path), JOB)
    settings = BusSettings("virtual", "rig", fd=True)
    assert list(bench_status.rig_status(settings, mapping)) == ["a", "b; c", "d; e"]
    assert adapter.mock_calls[0].args == (settings,), "its frames of CAN FD are read as well"
    assert not bench_status.bus_of(BusSettings("virtual", "rig"), mapping).fd
    wide = load(written(tmp_path, "answer = 0x7B8", "answer = 0x7B8\nfd = true"), JOB)
    assert bench_status.bus_of(BusSettings("virtual", "rig"), wide).fd


def test_doctor_listens_for_three_cycles_of_the_slowest_frame(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lid every 2 s, and the state every 100 ms."""
    cycles = "".join(f'BA_ "GenMsgCycleTime" BO_ {number} {ms};\n' for number, ms in ((544, 100), (546, 2000)))
    more = f"""BO_ 546 PlcLid: 1 Plc
 SG_ Open : 0|1@1+ (1,0) [0|1] "" Pc
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
{cycles}"""
    monkeypatch.setattr(foreign_rig, "DBC", foreign_rig.DBC.replace("VAL_ 528", f"{more}VAL_ 528", 1))
    lid = '\n[outputs.lid]\nmessage = "PlcLid"\nsignal = "Open"\n'
    monkeypatch.setattr(foreign_rig, "MAPPING", foreign_rig.MAPPING + lid)
    (_, missing) = examined(tmp_path, Frame(545, bytes(8)))[Grade.ERROR]
    assert missing.startswith("PlcLid (0x222): none came in 6.")


SUPERVISED = 'BA_DEF_ BO_ "E2EDataId" INT 0 65535;\nBA_DEF_DEF_ "E2EDataId" 0;\n'


def test_frames_of_each_supervised_message_have_their_own_counters(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = "".join(
        f'BO_ {number} {name}: 3 Pc\n SG_ Value : 16|8@1+ (1,0) [0|255] "" Plc\n'
        ' SG_ Crc8 : 0|8@1+ (1,0) [0|255] "" Plc\n SG_ Counter : 8|4@1+ (1,0) [0|14] "" Plc\n'
        for number, name in ((600, "One"), (601, "Two"))
    )
    ids = SUPERVISED + "".join(f'BA_ "E2EDataId" BO_ {number} {number};\n' for number in (600, 601))
    monkeypatch.setattr(foreign_rig, "DBC", foreign_rig.DBC.replace("VAL_ 528", f"{messages}{ids}VAL_ 528", 1))
    bus, wire = opened(tmp_path, clock)
    for number in range(17):
        bus.send("One", {"Value": number})
        if number % 8 == 0:
            bus.send("Two", {"Value": number})
    readings = [Codec(tmp_path / "rig.dbc").decode(frame) for frame in wire.log]
    assert all(reading.intact for reading in readings)
    assert [reading.counter for reading in readings if reading.message == "One"] == [*range(15), 0, 1]
    assert [reading.counter for reading in readings if reading.message == "Two"] == [0, 1, 2]


def test_channel_is_locked_while_the_bus_is_open_and_not_by_who_stops_the_rig(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    log: list[str] = []

    def lock(settings: BusSettings) -> Any:
        log.append("locked")
        return lambda: log.append("released")

    monkeypatch.setattr(mapped_bus, "lock_channel", lock)
    bus, wire = opened(tmp_path, clock)
    assert log == ["locked"]
    bus.close()
    assert (log, wire.close.call_count) == (["locked", "released"], 1)
    failing, wire = opened(tmp_path, clock)
    wire.close.side_effect = BusError("it does not end")
    with pytest.raises(BusError):
        failing.close()
    assert log == 2 * ["locked", "released"]
    mapping = load(written(tmp_path), JOB)
    with monkeypatch.context() as patch:
        patch.setattr(mapped_bus, "connected", Mock(side_effect=BusError("no adapter")))
        with pytest.raises(BusError, match="no adapter"):
            MappedBus(BusSettings(), None, mapping, 5, 7)
    assert log == 3 * ["locked", "released"]
    MappedBus(BusSettings(), None, mapping, 5, 7, is_alone=False).close()
    assert len(log) == 6


def test_peer_has_its_own_patience_and_format(tmp_path: Path, clock: Clock) -> None:
    """Three tries of seven seconds, in frames of CAN FD, which the bus is opened for."""
    mapping = load(written(tmp_path, "answer = 0x7B8", "answer = 0x7B8\nfd = true\nanswer_s = 7.0"), JOB)
    bus = MappedBus(BusSettings(), tmp_path, mapping, 5, 7)
    wire: Any = bus._bus
    assert wire.made[0].fd

    def silent(identifier: int, wait_s: float) -> None:
        assert identifier == 0x7B8
        clock.now += wait_s

    wire.receive = silent
    with pytest.raises(LinkTimeout, match=r"no answer of scanner \(0x7B0, 0x7B8\): identifier 0x0107"):
        bus.peer("scanner").read(0x0107)
    assert clock.now - 100.0 == pytest.approx(3 * 7.0, abs=0.5)
    frames = [frame for frame in wire.log if isinstance(frame, Frame)]
    assert [(frame.arbitration_id, frame.data[:4], frame.is_fd) for frame in frames] == 3 * [
        (0x7B0, b"\3\x22\1\7", True)
    ]


def steps_of(folder: Path, clock: Clock) -> tuple[MappedSteps, Connection, Peer]:
    """Steps to be made by hand, with a scanner that answers as it is told."""
    mapping = load(written(folder), JOB)
    bus = MappedBus(BusSettings(), None, mapping, 5, 7)
    clock.bus = bus._bus
    scanner: Any = Peer("scanner")
    bus._peers = {"scanner": scanner}
    return MappedSteps(bus, mapping, 9), clock.bus, scanner


GO: dict[str, Any] = {"do": "send", "message": "PlcCommand", "signals": {"LayerNo": "{layer}", "Go": "GO", "Lamp": 0}}
IS_READY = Wait(do="wait", message="PlcState", signal="State", expected="READY", limit_s=1.0)


def test_what_comes_after_an_action_is_waited_for_also_behind_a_read(tmp_path: Path, clock: Clock) -> None:
    """Another action forgets it."""
    steps, wire, scanner = steps_of(tmp_path, clock)
    wire.at_once, scanner.answers = [state(READY)], deque([b"\1"])
    look = Read(do="read", peer="scanner", identifier=0x107, expected=1)
    steps.do("a layer", (Send(**GO), look, IS_READY), 3)
    wire.at_once = []
    wire.others.append((0.0, state(READY)))
    with pytest.raises(LinkTimeout, match=r"PlcState\.State was not READY"):
        steps.do("a layer", (Send(**GO), IS_READY), 3)


def test_wait_of_a_step_ends_with_the_value_that_must_not_come(tmp_path: Path, clock: Clock) -> None:
    """Both may be templates."""
    steps, wire, _ = steps_of(tmp_path, clock)
    for change in ({"unless": "FAULT"}, {"signal": "LayersDone", "expected": "{layer}", "unless": "0x1{layer}"}):
        wire.others.append((0.0, state(FAULT, 0x13)))
        with pytest.raises(HardwareError, match=r"expected (READY|3); check the rig"):
            steps.do("a layer", (IS_READY.model_copy(update=change),), 3)
        assert clock.now == 100.0


def test_steps_that_act_are_recorded_with_their_numbers_and_enabled_as_long_as_they_last(
    tmp_path: Path, clock: Clock
) -> None:
    steps, wire, _ = steps_of(tmp_path, clock)

    @contextmanager
    def record(layer: int, place: int) -> Iterator[None]:
        wire.log.append((layer, place))
        yield
        wire.log.append("done")

    wire.others.append((0.0, state(READY)))
    harmless, acting = Send(**GO, acts=False), Send(**GO, enables=("lamp",))
    steps.do("a layer", (IS_READY, harmless, acting), 3, record)
    go = Frame(528, b"\3\0\1\0")
    assert wire.log == [go, (3, 3), Enables.LAMP, go, Enables.NONE, "done"]


def test_template_that_fails_in_a_later_layer_is_named_with_its_step(tmp_path: Path, clock: Clock) -> None:
    steps, wire, _ = steps_of(tmp_path, clock)
    short = RoutineStep(do="routine", peer="scanner", routine=1, option="{layer:02x}")
    with pytest.raises(
        ComponentError, match=r"^layer 256, step 2 \(routine\): '\{layer:02x\}'.*; correct the mapping$"
    ):
        steps.do("layer 256", (Send(**GO), short), 256)
    assert len(wire.log) == 1


def test_stop_is_made_beside_a_print_and_logs_no_traffic(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Connection] = []

    def connected(*arguments: Any) -> Connection:
        made.append(Connection(*arguments))
        return made[-1]

    monkeypatch.setattr(mapped_bus, "connected", connected)
    monkeypatch.setattr(mapped_bus, "lock_channel", Mock(side_effect=AssertionError))
    settings = BusSettings("virtual", "rig", traffic_log=Path("bus.blf"))
    with pytest.raises(HardwareError, match=r"rig\.toml: has no \[\[stop\]\] steps, so nothing was sent"):
        list(stop_rig(settings, load(written(tmp_path), JOB)))
    assert not made
    hold = 'signals = { LayerNo = "{layer}", Go = "HOLD", Lamp = 0 }'
    stop = f'[[stop]]\ndo = "send"\nmessage = "PlcCommand"\n{hold}\n\n[outputs'
    lines = list(stop_rig(settings, load(written(tmp_path, "[outputs", stop), JOB)))
    assert lines == ["all 1 [[stop]] steps of rig.toml were made; look at the rig before you go on"]
    (wire,) = made
    assert (wire.made[0].traffic_log, wire.log, wire.close.call_count) == (None, [Frame(528, bytes(4))], 1)


class Peer:
    """A peer that answers as it is told; `asked` has what it was asked."""

    def __init__(self, name: str, *answers: bytes) -> None:
        self.name, self.answers, self.asked = name, deque(answers), list[Any]()

    def read(self, identifier: int) -> bytes:
        self.asked.append(identifier)
        return self.answers[0] if len(self.answers) == 1 else self.answers.popleft()

    def routine(self, *asked: Any) -> bytes:
        self.asked.append(asked)
        return self.answers.popleft()

    def upload(self, place: Any, size: int, crc: bool) -> bytes:
        self.asked.append((place.address, place.memorysize, place.address_format, place.memorysize_format, size, crc))
        return self.answers.popleft()

    def download(self, place: Any, blob: bytes, crc: bool) -> None:
        self.asked.append((place.address, place.memorysize, place.address_format, place.memorysize_format, blob, crc))


@pytest.fixture
def rig(tmp_path: Path, clock: Clock) -> Any:
    """A rig after its start, its bus and its peers."""
    part, journal = Mapped(JOB, mapping=str(written(tmp_path))), MasterJournal()
    part.use_rig(SimpleNamespace(settings=BusSettings(), folder=tmp_path, session=5, job=9, **ANY_BED))  # type: ignore[arg-type]
    part.use_journal(journal)
    part.initialize(0, {"layer_command": np.asarray(2)})
    bus: Any = part._bus
    clock.bus = bus._bus
    peers = {name: Peer(name) for name in ("head", "scanner")}
    bus._peers = peers
    return SimpleNamespace(part=part, bus=bus, wire=bus._bus, peers=peers, clock=clock, journal=journal)


def scan(value: float, is_whole: bool = False) -> bytes:
    """A map of 6 x 5 cells, y by y, cell (2, 1) unmeasured unless it is whole."""
    cells = value + np.add.outer(np.arange(6.0), 10.0 * np.arange(5.0))
    cells[2, 1] = cells[2, 1] if is_whole else -999.0
    return b"HM\6\5" + cells.T.astype("<f4").tobytes()


def answer_scan(rig: Any, layer: int, value: float, is_whole: bool = False) -> None:
    rig.peers["scanner"].answers.extend([b"\1", b"\0" + layer.to_bytes(2, "big"), scan(value, is_whole)])


def test_layer_is_downloaded_commanded_waited_for_and_scanned(rig: Any) -> None:
    pattern = np.zeros((6, 5), np.int32)
    pattern[4, 1], pattern[0, 3] = 1, 1
    answer_scan(rig, 2, 5.0, is_whole=True)
    answer_scan(rig, 3, 7.0)
    rig.wire.at_once = [state(BUSY)]
    rig.clock.after.extend([state(READY, 3, 12.5)])
    found = rig.part.do_step(0, 1, {"pattern": pattern, "layer_command": np.asarray(3)})
    blob = bytearray(b"\xa5\0\3" + bytes(10))
    blob[3 + 2 + 1], blob[3 + 2 * 3] = 1, 1  # two bits for each of six cells: cell 4 of row 1, cell 0 of row 3
    assert rig.peers["head"].asked == [(3, 13, 32, 16, bytes(blob), False)]
    assert [frame for frame in rig.wire.log if isinstance(frame, Frame)] == [Frame(528, bytes([3, 0, 1, 75]))]
    size = 4 + 4 * 30
    assert rig.peers["scanner"].asked == [
        entry
        for layer in (2, 3)
        for entry in ((0x0310, bytes([0, layer]), 10.0), 0x0107, (0x20, size, 8, 16, size, True))
    ]
    assert (int(found["layers_printed"]), int(found["layers_scanned"])) == (3, 3)
    expected = (7.0 + np.add.outer(np.arange(6.0), 10.0 * np.arange(5.0))) * 1e-6
    expected[2, 1] = 17e-6  # of the scan before
    np.testing.assert_allclose(found["measured_height"], expected, rtol=1e-6)
    assert np.argwhere(~found["valid"]).tolist() == [[2, 1]]
    assert float(found["bed_position"]) == pytest.approx(0.0125, rel=1e-9, abs=0.0)
    again = rig.part.do_step(1, 1, {"pattern": pattern, "layer_command": np.asarray(3)})
    assert len(rig.peers["head"].asked) == 1
    assert len(rig.peers["scanner"].asked) == 6
    assert int(again["layers_printed"]) == 3


def test_state_of_a_rig_comes_back(rig: Any, tmp_path: Path) -> None:
    answer_scan(rig, 2, 5.0)
    before = rig.part.do_step(0, 1, {"pattern": np.zeros((6, 5), np.int32), "layer_command": np.asarray(2)})
    saved = rig.part.save()
    other = Mapped(JOB, mapping=str(tmp_path / "rig.toml"))
    own = SimpleNamespace(
        settings=BusSettings(), folder=tmp_path, session=6, job=1, is_open=False, valid_share=0.0, on_part=True
    )
    other.use_rig(own)  # type: ignore[arg-type]
    other.initialize(0, {})
    other.restore(saved)
    assert own.job == 9
    found = other._outputs()
    for name in ("layers_printed", "layers_scanned", "measured_height", "valid"):
        np.testing.assert_array_equal(found[name], before[name])
    assert int(found["layers_printed"]) == int(found["layers_scanned"]) == 2
    with pytest.raises(ComponentError, match="the saved state is not one of this rig"):
        other.restore(saved[:-1])


def test_answer_that_begins_otherwise_is_refused(rig: Any) -> None:
    rig.peers["scanner"].answers.append(b"\2\3")
    with pytest.raises(TransferError, match=r"scanner answers routine 0x0310 with 02 03, expected 01; check the rig"):
        rig.part.do_step(0, 1, {"pattern": np.zeros((6, 5), np.int32), "layer_command": np.asarray(2)})


def test_identifier_that_stays_another_is_reported_with_what_it_is(rig: Any) -> None:
    rig.peers["scanner"].answers.extend([b"\1", b"\0\0\1"])
    with pytest.raises(LinkTimeout, match=r"identifier 0x0107 of scanner was not 2 within 10 s; it is 00 00 01"):
        rig.part.do_step(0, 1, {"pattern": np.zeros((6, 5), np.int32), "layer_command": np.asarray(2)})
    assert rig.clock.now == pytest.approx(110.1, rel=0.0, abs=0.06)


def test_answer_that_is_too_short_is_read_again(rig: Any) -> None:
    rig.peers["scanner"].answers.extend([b"\1", b"\0\2", b"\0\0\2", scan(1.0)])
    rig.part.do_step(0, 1, {"pattern": np.zeros((6, 5), np.int32), "layer_command": np.asarray(2)})
    assert rig.peers["scanner"].asked[1:3] == [0x0107, 0x0107]


def test_rig_that_is_not_open_says_so(tmp_path: Path) -> None:
    part = Mapped(JOB, mapping=str(written(tmp_path)))
    with pytest.raises(ComponentError, match="the bus is not open: call initialize first"):
        part.do_step(0, 1, {})
    part.terminate()


def test_each_step_of_a_layer_is_in_the_journal_before_it_is_made_and_the_layer_at_its_end(rig: Any) -> None:
    pattern, seen = np.zeros((6, 5), np.int32), []
    pattern[5, 4] = 1
    answer_scan(rig, 2, 5.0)
    answer_scan(rig, 3, 5.0)
    rig.peers["head"].download = lambda *_: seen.append(rig.journal.records[-1])
    rig.wire.at_once = [state(BUSY), state(READY, 3)]
    rig.part.do_step(0, 1, {"pattern": pattern, "layer_command": np.asarray(3)})
    opened, *records = rig.journal.records
    assert (opened.event, opened.key) == (Event.OPENED, Key(9, 0))
    assert [(record.event, record.asked, record.key) for record in records] == [
        (Event.INTENT, Asked.STEP, Key(9, 3, 1)),
        (Event.DONE, Asked.STEP, Key(9, 3, 1)),
        (Event.INTENT, Asked.STEP, Key(9, 3, 2)),
        (Event.DONE, Asked.STEP, Key(9, 3, 2)),
        (Event.DONE, Asked.LAYER, Key(9, 3)),
    ]
    assert seen == records[:1]
    assert {record.pattern_crc for record in records} == {zlib.crc32(pattern.astype("<i4").tobytes())}


@pytest.mark.parametrize(("looked", "is_unknown"), [(Event.UNKNOWN, True), (Event.PRINTED, False)])
def test_layer_that_a_person_has_looked_at_is_not_printed_again(rig: Any, looked: Event, is_unknown: bool) -> None:
    pattern = np.ones((6, 5), np.int32)
    crc, key = zlib.crc32(pattern.astype("<i4").tobytes()), Key(9, 3)
    rig.journal.intend(Asked.STEP, Key(9, 3, 1), crc)
    rig.journal.settle(looked, key, crc)
    answer_scan(rig, 2, 5.0)
    answer_scan(rig, 3, 7.0)
    found = rig.part.do_step(0, 1, {"pattern": pattern, "layer_command": np.asarray(3)})
    assert (int(found["layers_printed"]), bool(found["layer_unknown"])) == (3, is_unknown)
    assert rig.peers["head"].asked == []
    saved = rig.part.save()
    rig.part.terminate()
    again = rig.part.initialize(0, {"layer_command": np.asarray(3)})
    assert (int(again["layers_printed"]), int(again["layers_scanned"])) == (3, -1)
    assert not again["layer_unknown"]
    rig.part.restore(saved)
    assert bool(rig.part._outputs()["layer_unknown"]) is is_unknown


def test_state_before_the_first_scan_comes_back(rig: Any) -> None:
    saved = rig.part.save()
    rig.part.initialize(0, {})
    rig.part.restore(saved)
    found = rig.part._outputs()
    assert (int(found["layers_printed"]), int(found["layers_scanned"])) == (2, -1)


def test_output_of_a_signal_is_nan_until_a_frame_brings_a_value(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign_rig, "DBC", foreign_rig.DBC.replace("[0|655.35]", "[0|100]"))
    part = Mapped(JOB, mapping=str(written(tmp_path)))
    part.use_rig(SimpleNamespace(settings=BusSettings(), folder=tmp_path, session=5, job=9, **ANY_BED))  # type: ignore[arg-type]
    found = [float(part.initialize(0, {})["bed_position"])]
    for position_mm in (12.5, 100.5):
        bus: Any = part._bus
        bus._bus.others.append((0.0, state(IDLE, 0, position_mm)))
        bus.take()
        found.append(float(part._outputs()["bed_position"]))
    assert found == pytest.approx([np.nan, 0.0125, np.nan], rel=1e-9, abs=0.0, nan_ok=True)


def test_maps_that_are_given_out_are_copies(rig: Any) -> None:
    answer_scan(rig, 2, 5.0)
    found = rig.part.do_step(0, 1, {"pattern": np.zeros((6, 5), np.int32), "layer_command": np.asarray(2)})
    found["measured_height"][:] = found["valid"][:] = 9
    again = rig.part._outputs()
    assert again["measured_height"].max() < 1e-4
    assert not again["valid"][2, 1]

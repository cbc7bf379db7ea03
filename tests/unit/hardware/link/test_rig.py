"""A master watches nodes and everyone else, waits with messages, and enables nothing beyond its steps.

It sends nothing before the nodes have forgotten every other master, by the clock of the frames it received.
"""

from __future__ import annotations

import logging
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import (
    AnotherMaster,
    BusDisconnected,
    BusError,
    HardwareError,
    NodeLost,
    NodeStopped,
    StopRequested,
)
from inkloop_hardware.link import rig as rig_module
from inkloop_hardware.link.node_watch import OVER_AFTER
from inkloop_hardware.link.rig import ANSWER_GRACE_S, NodeWire, Rig
from inkloop_hardware.link.supervision import FIRST_BEATS, KEEP_ALIVE_PERIOD_S, Supervision
from inkloop_hardware.protocol.codec import COUNTERS, Frame
from inkloop_hardware.protocol.records import Fault, MasterAlive, Node, NodeFault, Source, State, StopRequest, pack
from support.benches.faulty_wire import CODEC
from support.benches.node_status import IDLE_HEAD

SILENCE_S, CYCLE_S = 2.0, 0.1
SETTINGS = BusSettings("virtual", "test", traffic_log=Path("traffic.blf"), silence_s=SILENCE_S)
OWN, OTHER = 4, MasterAlive(lamp_enable=False, gate_enable=True, motion_enable=True, session=5, job=7)
STOP = pack(CODEC, StopRequest(True, Source.OPERATOR), 0)


class Bus:
    """A bus by an injected clock, on which time passes while somebody sleeps, and another master sends until `ends_at`.

    is_live: its opener listens first; log: what was asked of it; happen: what happens with each sleep.
    """

    priority = "nice -10"

    def __init__(self, *, is_live: bool = False, ends_at: float = 0.0) -> None:
        self.is_live, self.ends_at = is_live, ends_at
        self.clock = 0.0 if is_live else 100.0
        self.others, self.messages = deque[tuple[float, Frame]](), deque[str]()
        self.disconnected, self.fails_at = "", float("inf")
        self.log: list[Any] = []
        self.beats: list[float] = []
        self.opened: list[BusSettings] = []
        self.happen: Callable[[], None] = lambda: None
        self._counters = count()

    @property
    def is_closed(self) -> bool:
        return "closed" in self.log

    def now(self) -> float:
        return self.clock

    def sleep(self, seconds: float) -> None:
        self.clock += CYCLE_S if self.is_live else seconds
        if self.clock <= self.ends_at:
            self.bring(pack(CODEC, OTHER, next(self._counters) % COUNTERS))
        self.happen()

    def bring(self, *frames: Frame) -> None:
        self.others.extend((self.clock, frame) for frame in frames)

    def bring_status(self) -> None:
        self.bring(pack(CODEC, IDLE_HEAD, next(self._counters) % COUNTERS))

    def check(self) -> None:
        if self.clock > self.fails_at:
            raise BusError("the bus process ended")

    def send_keep_alive(self, enables: Enables) -> None:
        self.check()
        self.log.append(enables)
        self.beats.append(self.clock)

    def send_job(self, job: int) -> None:
        self.log.append(("job", job))

    def close(self) -> None:
        self.log.append("closed")


def patched(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> Bus:
    """This bus in place of a bus process."""

    def opened(settings: BusSettings, *_: object) -> Bus:
        bus.opened.append(settings)
        bus.check()
        return bus

    monkeypatch.setattr(rig_module, "connected", opened)
    return bus


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    return patched(Bus(), monkeypatch)


def opened(bus: Bus) -> Supervision:
    made = Supervision(CODEC, OWN, "the bus of the test", SILENCE_S)
    made.open(bus)  # type: ignore[arg-type]
    return made


@pytest.fixture
def watching(bus: Bus) -> Supervision:
    return opened(bus)


@pytest.mark.parametrize("ends_at", [0.0, 1.0, 3.0], ids=["quiet bus", "a run that ends", "one that ends late"])
def test_heartbeat_begins_after_the_silence_of_others(ends_at: float, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = patched(Bus(is_live=True, ends_at=ends_at), monkeypatch)
    assert opened(bus).is_open
    assert ends_at + 1.2 * SILENCE_S < bus.beats[0] < ends_at + 1.5 * SILENCE_S


@pytest.mark.parametrize(
    ("fails_at", "error", "message"),
    [
        (float("inf"), AnotherMaster, "another master is active on this bus, session 5: end it"),
        (1.0, BusError, "the bus process ended"),
    ],
)
def test_bus_with_a_master_that_stays_or_that_fails_is_closed_undisturbed(
    fails_at: float, error: type[HardwareError], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = patched(Bus(is_live=True, ends_at=float("inf")), monkeypatch)
    bus.fails_at = fails_at
    with pytest.raises(error, match=message):
        opened(bus)
    assert (bus.is_closed, bus.beats) == (True, [])


def test_bus_is_opened_by_the_first_user_and_closed_by_the_last(bus: Bus, tmp_path: Path) -> None:
    rig = Rig(SETTINGS, folder=tmp_path)
    rig.detach()
    for users in (1, 2):
        rig.attach()
        assert (rig.is_open, len(bus.opened)) == (True, 1), users
    assert bus.opened[0].traffic_log == tmp_path / "traffic.blf"
    rig.detach()
    assert rig.is_open
    rig.detach()
    assert (rig.is_open, bus.log[-1]) == (False, "closed")
    rig.detach()
    rig.attach()
    assert (rig.is_open, len(bus.opened)) == (True, 2)


def test_user_whose_bus_does_not_open_is_none(bus: Bus) -> None:
    rig = Rig(SETTINGS)
    bus.fails_at = 0.0
    with pytest.raises(BusError):
        rig.attach()
    assert not rig.is_open
    bus.fails_at = float("inf")
    rig.attach()
    assert rig.is_open
    rig.detach()
    assert not rig.is_open


def test_bus_is_opened_for_session_and_job_and_its_channel_locked_until_it_is_closed(
    bus: Bus, monkeypatch: pytest.MonkeyPatch
) -> None:
    log: list[str] = []
    asked: list[Any] = []

    def lock(settings: BusSettings) -> Callable[[], None]:
        log.append("locked")
        return lambda: log.append("released")

    def connected(settings: BusSettings, *rest: Any) -> Bus:
        asked.append(rest)
        bus.check()
        return bus

    monkeypatch.setattr(rig_module, "lock_channel", lock)
    monkeypatch.setattr(rig_module, "connected", connected)
    rig = Rig(SETTINGS)
    rig.job = 9
    assert not bus.log, "a bus that is closed is told nothing"
    with rig:
        assert log == ["locked"]
    assert log == ["locked", "released"]
    ((session, job, answers, kept),) = asked
    assert (session, job, list(answers)) == (rig.session, 9, [0x641, 0x643, 0x645, 0x647])
    assert kept is rig.supervision.supervised_ids
    bus.fails_at = 0.0
    with pytest.raises(BusError):
        rig.attach()
    assert log == 2 * ["locked", "released"]


def test_replay_has_the_job_of_its_log(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    bus.job = 77  # type: ignore[attr-defined]
    monkeypatch.setattr(rig_module, "ReplayConnection", lambda settings: bus)
    with Rig(BusSettings("replay", "traffic.blf")) as rig:
        assert rig.job == 77


def test_link_has_the_patience_of_the_settings_and_its_problems_are_logged_at_the_end(
    bus: Bus, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "inkloop_hardware")
    with Rig(replace(SETTINGS, answer_s=7.0)) as rig:
        link = rig.link(Node.HEAD)
        assert rig.link(Node.HEAD) is link is not rig.link(Node.CURE)
        assert link.requests.client.config["p2_timeout"] == 7.0
        link.requests.repeated, link.requests.connection.stray, link.requests.connection.broken = 1, 2, 3
        link._restarted = 4
        assert not any("sent again" in words for words in caplog.messages)
    assert [words for words in caplog.messages if "sent again" in words] == [
        "head: 1 requests sent again, 2 answers late or doubled, 3 frames out of order, 4 transfers restarted"
    ]


def interrupted(rig: Rig, bus: Bus) -> None:
    with rig.enabled(gate=True, motion=True):
        assert bus.log[-1] == Enables.GATE | Enables.MOTION
        raise KeyboardInterrupt


def without_bus(rig: Rig, bus: Bus) -> None:
    with rig.enabled(motion=True):
        bus.fails_at = 0.0
        raise NodeLost("the cause")


def test_enables_end_with_their_step_also_with_one_that_fails(bus: Bus) -> None:
    with Rig(SETTINGS) as rig:
        with rig.enabled(lamp=True):
            assert bus.log[-1] == Enables.LAMP
        assert bus.log[-1] == Enables.NONE
        with pytest.raises(KeyboardInterrupt):
            interrupted(rig, bus)
        assert bus.log[-1] == Enables.NONE
        with pytest.raises(NodeLost, match="the cause"):
            without_bus(rig, bus)
        assert not rig.supervision.enables, "a bus process that ended hides no cause"
        bus.fails_at = float("inf")


def test_steps_do_not_overlap_and_a_job_stays_while_one_is_enabled(bus: Bus) -> None:
    with Rig(SETTINGS) as rig:
        with rig.enabled(motion=True):
            with pytest.raises(HardwareError, match="a step is enabled already"), rig.enabled(lamp=True):
                pass
            with pytest.raises(HardwareError, match="the job cannot change while a step is enabled"):
                rig.job = 9
            assert bus.log[-1] == Enables.MOTION
        rig.job = 9
        assert (rig.job, bus.log[-1]) == (9, ("job", 9))


def test_nothing_is_enabled_while_a_stop_request_is_active(bus: Bus) -> None:
    with Rig(SETTINGS) as rig:
        bus.bring(STOP)
        with pytest.raises(StopRequested), rig.enabled(lamp=True):
            pass
        assert set(bus.log) == {Enables.NONE}


def test_nodes_have_fifteen_silences_to_appear(bus: Bus) -> None:
    with Rig(SETTINGS) as rig:
        for limit_s in (None, 2.0):
            began = bus.clock
            with pytest.raises(NodeLost, match="the head has sent no status"):
                rig.wait_for((Node.HEAD,), limit_s)
            assert 0 < bus.clock - began - (15 * SILENCE_S if limit_s is None else limit_s) < 0.1


def test_requests_wait_until_the_nodes_have_heard_this_master(bus: Bus) -> None:
    bus.happen = bus.bring_status
    with Rig(SETTINGS) as rig:
        began = bus.clock
        rig.wait_for((Node.HEAD,))
        assert FIRST_BEATS < bus.clock - began < 2 * FIRST_BEATS
        bus.disconnected, unplugged = "unplugged", bus.clock

        def plug_in_again() -> None:
            bus.bring_status()
            bus.disconnected = "unplugged" if bus.clock < unplugged + 1 else ""

        bus.happen = plug_in_again
        rig.wait_for((Node.HEAD,))
        assert 1 + FIRST_BEATS < bus.clock - unplugged < 1 + 2 * FIRST_BEATS
        bus.disconnected, bus.happen = "unplugged", bus.bring_status
        with pytest.raises(BusDisconnected, match="unplugged"):
            rig.wait_for((Node.HEAD,), 2.0)


@pytest.mark.parametrize("number", [0, -1, 1 << 32])
def test_session_and_job_are_numbers_that_are_not_0(number: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """0 is what a node has before its first master."""
    with pytest.raises(ValueError, match=f"job is {number}, expected 1 to 4294967295"):
        Rig(SETTINGS).job = number
    monkeypatch.setattr(secrets, "randbelow", lambda below: 0)
    assert (Rig(SETTINGS).session, Rig(SETTINGS).job) == (1, 1)
    monkeypatch.setattr(secrets, "randbelow", lambda below: below - 1)
    assert (Rig(SETTINGS).session, Rig(SETTINGS).job) == (0xFFFF, 0xFFFFFFFF)


def test_heartbeat_is_kept_alive_no_more_often_than_it_needs(bus: Bus, watching: Supervision) -> None:
    """A waiting link calls it all the time; a change of enables is sent at once."""
    for _ in range(40):
        watching.keep_alive()
        bus.clock += KEEP_ALIVE_PERIOD_S / 8
    assert len(bus.beats) == 5
    watching.enable(Enables.GATE)
    assert (bus.beats[-1], bus.log[-1]) == (bus.clock, Enables.GATE)


def test_only_the_nodes_of_a_request_are_missed(bus: Bus, watching: Supervision) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0))
    watching.check((Node.HEAD,))
    with pytest.raises(NodeLost, match=r"^the bus of the test: the stage has sent no status$"):
        watching.check((Node.HEAD, Node.STAGE))


def test_node_is_lost_after_the_silence_that_was_set(bus: Bus, watching: Supervision) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0))
    bus.clock += 0.5 * SILENCE_S
    watching.check((Node.HEAD,))
    bus.clock += 0.4 * SILENCE_S
    watching.check((Node.HEAD,))
    bus.clock += 0.2 * SILENCE_S
    with pytest.raises(NodeLost, match="the head"):
        watching.check((Node.HEAD,))


def test_repeated_status_does_not_show_that_a_node_is_alive(bus: Bus, watching: Supervision) -> None:
    for counter, seconds in ((0, 0.0), (1, 0.0), (1, 0.9 * SILENCE_S)):
        bus.clock += seconds
        bus.bring(pack(CODEC, IDLE_HEAD, counter))
        watching.check((Node.HEAD,))
    bus.clock += 0.2 * SILENCE_S
    with pytest.raises(NodeLost, match=r"the head has been silent for 2\.2 s"):
        watching.check((Node.HEAD,))


def test_stop_request_whose_sender_went_away_is_forgotten(bus: Bus, watching: Supervision) -> None:
    bus.bring(STOP)
    with pytest.raises(StopRequested):
        watching.check_alone()
    bus.clock += OVER_AFTER
    with pytest.raises(StopRequested):
        watching.check_alone()
    bus.clock += 0.01
    watching.check_alone()


def test_damaged_frames_count_against_their_node_and_unknown_content_is_logged(
    bus: Bus, watching: Supervision, caplog: pytest.LogCaptureFixture
) -> None:
    whole = [pack(CODEC, IDLE_HEAD, counter) for counter in range(3)]
    short = Frame(whole[0].arbitration_id, whole[0].data[:5])
    bus.bring(whole[0], short, whole[1])
    watching.check((Node.HEAD,))
    assert "has 5 bytes" in caplog.text
    damaged = Frame(whole[2].arbitration_id, bytes([whole[2].data[0] ^ 1]) + whole[2].data[1:])
    bus.bring(damaged, damaged)
    with pytest.raises(NodeLost, match="of its frames 2 were damaged, 0 repeated, 0 jumped"):
        watching.check((Node.HEAD,))


def test_stop_request_comes_before_another_master(bus: Bus, watching: Supervision) -> None:
    others = [pack(CODEC, OTHER, counter) for counter in range(2)]
    bus.bring(*others, STOP)
    with pytest.raises(StopRequested, match="stop request of the operator"):
        watching.check_alone()
    bus.bring(pack(CODEC, StopRequest(False, Source.OPERATOR), 1))
    with pytest.raises(AnotherMaster, match="session 5"):
        watching.check_alone()


def test_bus_that_is_opened_again_is_known_by_nothing_of_before(bus: Bus, watching: Supervision) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0), STOP)
    watching.enable(Enables.LAMP)
    watching.close()
    assert (watching.is_open, watching.enables, bus.is_closed) == (False, Enables.NONE, True)
    assert watching.watch(Node.HEAD).status == IDLE_HEAD, "what came before its end is taken"
    bus.clock += KEEP_ALIVE_PERIOD_S
    watching.open(bus)  # type: ignore[arg-type]
    assert (bus.beats[-1], bus.log[-1]) == (bus.clock, Enables.NONE)
    watching.check_alone()
    with pytest.raises(NodeLost, match="the head has sent no status"):
        watching.check((Node.HEAD,))


LAMP = replace(IDLE_HEAD, node=Node.CURE, lamp_on=True, state=State.CURING)
FALLEN = replace(LAMP, state=State.FAULT, fault=Fault.GATE_NOT_CONFIRMED)


class Lamp:
    """A wire to a lamp that is on; `status` brings a status of it, `wait` looks at it as a wait does."""

    def __init__(self, bus: Bus, watching: Supervision, first: Any = LAMP) -> None:
        self.bus, self._counters = bus, count()
        self.status(first)
        self.wire = NodeWire(watching, Node.CURE)
        self.wire.begin()

    def status(self, record: Any) -> None:
        self.bus.bring(pack(CODEC, record, next(self._counters) % COUNTERS))

    def wait(self, seconds: float = 0.0) -> None:
        self.bus.clock += seconds
        self.wire.check()


def test_wait_reports_that_the_loop_is_alive_and_ends_with_the_node(bus: Bus, watching: Supervision) -> None:
    lamp = Lamp(bus, watching)
    before = len(bus.beats)
    for _ in range(5):
        lamp.wait(KEEP_ALIVE_PERIOD_S)
    assert len(bus.beats) == before + 5
    with pytest.raises(NodeLost, match=r"cure has been silent for 2\.2 s"):
        lamp.wait(SILENCE_S + 0.1)


def test_node_that_enters_fault_is_given_a_moment_to_report_it(bus: Bus, watching: Supervision) -> None:
    lamp = Lamp(bus, watching)
    bus.bring(pack(CODEC, NodeFault(Node.CURE, Fault.GATE_NOT_CONFIRMED, 1, 3, 0.1)))
    lamp.wait()
    lamp.status(FALLEN)
    lamp.wait(ANSWER_GRACE_S)
    with pytest.raises(NodeStopped, match=r"de-energised state \(gate not confirmed\).*clear") as caught:
        lamp.wait(0.01)
    assert caught.value.fault is Fault.GATE_NOT_CONFIRMED


def test_each_request_gives_a_fallen_node_its_own_moment(bus: Bus, watching: Supervision) -> None:
    """Who else is on the bus is the reason that counts."""
    lamp = Lamp(bus, watching)
    for _ in range(2):
        lamp.status(FALLEN)
        lamp.wait(ANSWER_GRACE_S + 0.01)
        lamp.status(LAMP)
        lamp.wire.begin()
    lamp.status(FALLEN)
    lamp.wait()
    bus.bring(*(pack(CODEC, OTHER, counter) for counter in range(2)))
    with pytest.raises(NodeStopped, match=r"during a request; .*another master is active"):
        lamp.wait(ANSWER_GRACE_S + 0.01)


def test_node_that_was_off_before_may_be_asked(bus: Bus, watching: Supervision) -> None:
    off = replace(LAMP, state=State.SAFE, fault=Fault.MASTER_LOST)
    lamp = Lamp(bus, watching, off)
    for _ in range(10):
        lamp.status(off)
        bus.bring(pack(CODEC, NodeFault(Node.CURE, Fault.MASTER_LOST, 1, 3, 0.1)))
        lamp.wait(0.1)

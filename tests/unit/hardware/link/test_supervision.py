"""A master sends nothing before the nodes have forgotten every other one, by the clock of the frames it received; then
it watches them and everyone else."""

from __future__ import annotations

from collections import deque
from itertools import count

import pytest

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.errors import AnotherMaster, BusError, NodeLost, StopRequested
from inkloop_hardware.link import supervision
from inkloop_hardware.link.node_watch import OVER_AFTER
from inkloop_hardware.link.supervision import KEEP_ALIVE_PERIOD_S, Supervision
from inkloop_hardware.protocol.codec import COUNTERS, Frame
from inkloop_hardware.protocol.records import MasterAlive, StopRequest, pack
from inkloop_hardware.protocol.vocabulary import Node, Source
from support.benches.faulty_wire import CODEC
from support.benches.node_status import IDLE_HEAD

SILENCE_S, CYCLE_S = 2.0, 0.1
OWN, OTHER = 4, MasterAlive(lamp_enable=False, gate_enable=True, motion_enable=True, session=5, job=7)


class Bus:
    """A bus by an injected clock, on which another master sends until second `ends_at`."""

    is_live = True

    def __init__(self, ends_at: float) -> None:
        self.clock, self.ends_at = 0.0, ends_at
        self.others, self.messages = deque[tuple[float, Frame]](), deque[str]()
        self.disconnected, self.fails_at = "", float("inf")
        self.began: list[float] = []
        self.closed = False
        self._counters = count()

    def pass_cycle(self) -> None:
        self.clock += CYCLE_S
        if self.clock <= self.ends_at:
            self.others.append((self.clock, pack(CODEC, OTHER, next(self._counters) % COUNTERS)))

    def check(self) -> None:
        if self.clock > self.fails_at:
            raise BusError("the bus process ended")

    def send_keep_alive(self, enables: Enables) -> None:
        assert not enables
        self.began.append(self.clock)

    def close(self) -> None:
        self.closed = True


def opened(bus: Bus, monkeypatch: pytest.MonkeyPatch) -> Supervision:
    made = Supervision(CODEC, OWN, "the bus of the test", SILENCE_S)
    monkeypatch.setattr(supervision.time, "sleep", lambda _seconds: bus.pass_cycle())  # type: ignore[attr-defined]
    made.open(bus)  # type: ignore[arg-type]
    return made


@pytest.mark.parametrize("ends_at", [0.0, 1.0, 3.0], ids=["quiet bus", "a run that ends", "one that ends late"])
def test_heartbeat_begins_after_the_silence_of_others(ends_at: float, monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus(ends_at)
    assert opened(bus, monkeypatch).is_open
    assert ends_at + SILENCE_S < bus.began[0] < ends_at + 1.5 * SILENCE_S


def test_master_that_stays_is_an_error_and_is_not_disturbed(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus(ends_at=float("inf"))
    with pytest.raises(AnotherMaster, match="another master is active on this bus, session 5: end it"):
        opened(bus, monkeypatch)
    assert bus.closed
    assert not bus.began


def test_bus_that_fails_meanwhile_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus(ends_at=0.0)
    bus.fails_at = 1.0
    with pytest.raises(BusError, match="ended"):
        opened(bus, monkeypatch)
    assert bus.closed
    assert not bus.began


class Watched(Bus):
    """A bus that needs no listening; keeps the enables that were sent, with their times."""

    is_live = False

    def __init__(self) -> None:
        super().__init__(ends_at=0.0)
        self.clock, self.enabled = 10.0, list[tuple[float, Enables]]()

    def send_keep_alive(self, enables: Enables) -> None:
        self.enabled.append((self.clock, enables))

    def bring(self, *frames: Frame) -> None:
        self.others.extend((self.clock, frame) for frame in frames)


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Watched:
    made = Watched()
    monkeypatch.setattr(supervision.time, "monotonic", lambda: made.clock)  # type: ignore[attr-defined]
    return made


@pytest.fixture
def watching(bus: Watched, monkeypatch: pytest.MonkeyPatch) -> Supervision:
    return opened(bus, monkeypatch)


def test_heartbeat_is_kept_alive_no_more_often_than_it_needs(bus: Watched, watching: Supervision) -> None:
    """A waiting link calls it all the time; a change of enables is sent at once."""
    for _ in range(40):
        watching.keep_alive()
        bus.clock += KEEP_ALIVE_PERIOD_S / 8
    assert len(bus.enabled) == 5
    watching.enable(Enables.GATE)
    assert bus.enabled[-1] == (bus.clock, Enables.GATE)


def test_only_the_nodes_of_a_request_are_missed(bus: Watched, watching: Supervision) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0))
    watching.check((Node.HEAD,))
    with pytest.raises(NodeLost, match=r"^the bus of the test: the stage has sent no status$"):
        watching.check((Node.HEAD, Node.STAGE))


def test_node_is_lost_after_the_silence_that_was_set(bus: Watched, watching: Supervision) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0))
    watching.check((Node.HEAD,))
    bus.clock += 0.9 * SILENCE_S
    watching.check((Node.HEAD,))
    bus.clock += 0.2 * SILENCE_S
    with pytest.raises(NodeLost, match="the head"):
        watching.check((Node.HEAD,))


def test_repeated_status_does_not_show_that_a_node_is_alive(bus: Watched, watching: Supervision) -> None:
    for counter, seconds in ((0, 0.0), (1, 0.0), (1, 0.9 * SILENCE_S)):
        bus.clock += seconds
        bus.bring(pack(CODEC, IDLE_HEAD, counter))
        watching.check((Node.HEAD,))
    bus.clock += 0.2 * SILENCE_S
    with pytest.raises(NodeLost, match=r"the head has been silent for 2\.2 s"):
        watching.check((Node.HEAD,))


def test_stop_request_whose_sender_went_away_is_forgotten(bus: Watched, watching: Supervision) -> None:
    bus.bring(pack(CODEC, StopRequest(True, Source.OPERATOR), 0))
    with pytest.raises(StopRequested):
        watching.check_alone()
    bus.clock += OVER_AFTER
    with pytest.raises(StopRequested):
        watching.check_alone()
    bus.clock += 0.01
    watching.check_alone()


def test_damaged_frames_count_against_their_node_and_unknown_content_is_logged(
    bus: Watched, watching: Supervision, caplog: pytest.LogCaptureFixture
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


def test_stop_request_comes_before_another_master(bus: Watched, watching: Supervision) -> None:
    others = [pack(CODEC, OTHER, counter) for counter in range(2)]
    bus.bring(*others, pack(CODEC, StopRequest(True, Source.OPERATOR), 0))
    with pytest.raises(StopRequested, match="stop request of the operator"):
        watching.check_alone()
    bus.bring(pack(CODEC, StopRequest(False, Source.OPERATOR), 1))
    with pytest.raises(AnotherMaster, match="session 5"):
        watching.check_alone()


def test_bus_that_is_opened_again_is_known_by_nothing_of_before(
    bus: Watched, watching: Supervision, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus.bring(pack(CODEC, IDLE_HEAD, 0), pack(CODEC, StopRequest(True, Source.OPERATOR), 0))
    watching.enable(Enables.LAMP)
    watching.close()
    assert (watching.is_open, watching.enables, bus.closed) == (False, Enables.NONE, True)
    assert watching.watch(Node.HEAD).status == IDLE_HEAD, "what came before its end is taken"
    bus.clock += KEEP_ALIVE_PERIOD_S
    watching.open(bus)  # type: ignore[arg-type]
    assert bus.enabled[-1] == (bus.clock, Enables.NONE)
    watching.check_alone()
    with pytest.raises(NodeLost, match="the head has sent no status"):
        watching.check((Node.HEAD,))

"""The bus of a rig is opened once and closed with its last user; what a step enables ends with it, whatever happens."""

from __future__ import annotations

import secrets
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusDisconnected, BusError, HardwareError, NodeLost, StopRequested
from inkloop_hardware.link import rig as rig_module
from inkloop_hardware.link import supervision
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.link.supervision import FIRST_BEATS
from inkloop_hardware.protocol.codec import Frame
from inkloop_hardware.protocol.records import StopRequest, pack
from inkloop_hardware.protocol.vocabulary import Node, Source
from support.benches.faulty_wire import CODEC
from support.benches.node_status import IDLE_HEAD

SILENCE_S = 1.0
SETTINGS = BusSettings("virtual", "test", traffic_log=Path("traffic.blf"), silence_s=SILENCE_S)


class Bus:
    """A bus that needs no listening; `log` has what was asked of it. Time passes while the rig sleeps."""

    is_live = False
    priority = "nice -10"

    def __init__(self) -> None:
        self.clock = 100.0
        self.others, self.messages = deque[tuple[float, Frame]](), deque[str]()
        self.disconnected = ""
        self.log: list[Any] = []
        self.opened: list[BusSettings] = []
        self.happen: Callable[[], None] = lambda: None
        self.fails = False
        self._counter = 0

    def sleep(self, seconds: float) -> None:
        self.clock += seconds
        self.happen()

    def bring_status(self) -> None:
        self.others.append((self.clock, pack(CODEC, IDLE_HEAD, self._counter % 15)))
        self._counter += 1

    def check(self) -> None:
        if self.fails:
            raise BusError("the bus process ended")

    def send_keep_alive(self, enables: Enables) -> None:
        self.check()
        self.log.append(enables)

    def send_job(self, job: int) -> None:
        self.log.append(("job", job))

    def close(self) -> None:
        self.log.append("closed")


@pytest.fixture
def bus(monkeypatch: pytest.MonkeyPatch) -> Bus:
    made = Bus()

    def opened(settings: BusSettings, *_: object) -> Bus:
        made.opened.append(settings)
        made.check()
        return made

    monkeypatch.setattr(rig_module, "BusConnection", opened)
    monkeypatch.setattr(supervision.time, "monotonic", lambda: made.clock)  # type: ignore[attr-defined]
    monkeypatch.setattr(supervision.time, "sleep", made.sleep)  # type: ignore[attr-defined]
    return made


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
    bus.fails = True
    with pytest.raises(BusError):
        rig.attach()
    assert not rig.is_open
    bus.fails = False
    rig.attach()
    assert rig.is_open
    rig.detach()
    assert not rig.is_open


def interrupted(rig: Rig, bus: Bus) -> None:
    with rig.enabled(gate=True, motion=True):
        assert bus.log[-1] == Enables.GATE | Enables.MOTION
        raise KeyboardInterrupt


def without_bus(rig: Rig, bus: Bus) -> None:
    with rig.enabled(motion=True):
        bus.fails = True
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
        bus.fails = False


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
        bus.others.append((bus.clock, pack(CODEC, StopRequest(True, Source.OPERATOR), 0)))
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


def test_session_and_job_are_never_0(monkeypatch: pytest.MonkeyPatch) -> None:
    """0 is what a node has before its first master."""
    monkeypatch.setattr(secrets, "randbelow", lambda below: 0)
    assert (Rig(SETTINGS).session, Rig(SETTINGS).job) == (1, 1)
    monkeypatch.setattr(secrets, "randbelow", lambda below: below - 1)
    assert (Rig(SETTINGS).session, Rig(SETTINGS).job) == (0xFFFF, 0xFFFFFFFF)

"""A master sends nothing before the nodes have forgotten every other one, by the clock of the frames it received."""

from __future__ import annotations

from collections import deque
from itertools import count

import pytest

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.errors import AnotherMaster, BusError
from inkloop_hardware.link import supervision
from inkloop_hardware.link.supervision import Supervision
from inkloop_hardware.protocol.codec import COUNTERS, Frame
from inkloop_hardware.protocol.records import MasterAlive, pack
from support.benches.faulty_wire import CODEC

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

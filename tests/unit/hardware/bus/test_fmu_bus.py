"""A bench as an FMU on a bus of python-can: in real time for other programs, in its own time for ours."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import can
import pytest

from inkloop.errors import FmuError
from inkloop.fmu_writer.export import find_fmu
from inkloop_hardware.bus import fmu_bus
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.fmu_connection import FmuConnection, connected
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Frame

BENCH = str(find_fmu("BenchBus"))
SETTINGS = BusSettings("inkloop_fmu", BENCH)
HEAD, HEAD_STATUS, HEAD_ANSWER, MASTER_ALIVE = 0x640, 0x101, 0x641, 0x20
ARE_YOU_THERE = bytes.fromhex("023e00cccccccccc")


class Clock:
    """Stands for the module time; a sleep lasts as long as it is told."""

    def __init__(self) -> None:
        self.ns = 5_000_000_000

    def monotonic_ns(self) -> int:
        return self.ns

    def time(self) -> float:
        return 1e9

    def sleep(self, seconds: float) -> None:
        self.ns += round(seconds * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(fmu_bus, "time", found)
    return found


def test_bus_of_another_program_runs_with_the_clock(clock: Clock) -> None:
    """Up to 200 ms of delay by a busy machine are made up for; `recv(0)` brings the bench to the present."""
    with can.Bus(interface="inkloop_fmu", channel=BENCH) as bus:
        bus.set_filters([{"can_id": HEAD_STATUS, "can_mask": 0x7FF}])
        begun = clock.ns
        stamps = [message.timestamp for _ in range(20) if (message := bus.recv(0.1)) and not bus.recv(0)]
        assert (clock.ns - begun) / 1e9 == pytest.approx(stamps[-1] - 1e9, rel=1e-3, abs=0.0)
        assert [bus.recv(0.0) for _ in range(9)] == 9 * [None]
        before = bus.now()  # type: ignore[attr-defined]
        clock.ns += 60_000_000_000
        assert bus.recv(0) is not None
        while bus.recv(0):
            pass
        assert bus.now() - before == pytest.approx(0.2, abs=0.002)  # type: ignore[attr-defined]
        before = bus.now()  # type: ignore[attr-defined]
        clock.ns += 60_000_000_000
        bus.sleep(0.0)  # type: ignore[attr-defined]
        assert bus.now() - before == pytest.approx(0.2, abs=0.002)  # type: ignore[attr-defined]
        with pytest.raises(can.CanOperationError, match=r"classic CAN; set bench\.fd = false"):
            bus.send(can.Message(is_fd=True))


def test_frame_is_of_the_same_kind_behind_the_bus(clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    kinds = [(0x10640, True, False), (HEAD, False, True), (HEAD, False, False)]
    names = "identifier", "data", "is_extended", "is_remote"
    with can.Bus(interface="inkloop_fmu", channel=BENCH) as bus:
        echo = Mock(
            side_effect=lambda *step: [SimpleNamespace(**dict(zip(names, one, strict=True))) for one in step[2]]
        )
        monkeypatch.setattr(bus._node, "step", echo)  # type: ignore[attr-defined]
        for identifier, extended, remote in kinds:
            bus.send(can.Message(0.0, identifier, extended, remote))
        found = [message for _ in kinds if (message := bus.recv(0.1))]
    assert [(one.arbitration_id, one.is_extended_id, one.is_remote_frame) for one in found] == kinds


def test_time_of_our_own_bus_passes_while_it_is_waited_for(clock: Clock) -> None:
    adapter, begun = Adapter(SETTINGS), clock.ns
    try:
        assert (adapter.now(), adapter.receive(0.0)) == (0.0, [])
        adapter.sleep(0.5)
        assert [message.timestamp <= 0.5 for message in adapter.receive(0.0)].count(True) > 10
        adapter.send(Frame(HEAD, ARE_YOU_THERE))
        answers = {message.arbitration_id: message.timestamp for message in adapter.receive(1.0)}
        assert answers[HEAD_ANSWER] == adapter.now() == pytest.approx(0.501, abs=1e-9)
        assert clock.ns == begun
    finally:
        adapter.close()
    adapter = Adapter(replace(SETTINGS, options={"real_time": True}))
    assert adapter.now() == 1e9
    adapter.close()


@contextmanager
def opened(log: Path | None, *kept: Container[int]) -> Iterator[FmuConnection]:
    bus = connected(BusSettings("inkloop_fmu", BENCH, traffic_log=log), 5, 7, [HEAD_ANSWER], *kept)
    assert isinstance(bus, FmuConnection)
    with closing(bus):
        yield bus


def test_connection_keeps_heartbeat_and_log_in_the_time_of_the_fmu(tmp_path: Path) -> None:
    with opened(tmp_path / "it.blf") as bus:
        assert bus.receive(HEAD_ANSWER, 0.25) is None
        assert bus.clock == pytest.approx(0.25, abs=0.0011)
        bus.send_keep_alive(Enables.NONE)
        bus.send([Frame(HEAD, ARE_YOU_THERE)])
        assert (bus.receive(HEAD_ANSWER, 1.0) or b"")[:3] == b"\2\x7e\0"
        bus.sleep(1.0)
        assert {frame.arbitration_id for at, frame in bus.others if at <= bus.clock} >= {HEAD_STATUS, HEAD_STATUS + 1}
        bus.sleep(2.0)
        so_far = list(can.BLFReader(tmp_path / "it.blf"))
        assert so_far[-1].timestamp > bus.clock - 2.1, "written to the disk each second"
    logged = list(can.BLFReader(tmp_path / "it.blf"))
    beats = [frame.timestamp for frame in logged if frame.arbitration_id == MASTER_ALIVE]
    assert len(beats) == 32, "each 100 ms, the first one twice, and the last one"
    assert all(frame.is_rx == (frame.arbitration_id not in (MASTER_ALIVE, HEAD)) for frame in logged)


def test_fmu_that_fails_in_a_step_is_an_error_of_the_bus(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with opened(tmp_path / "it.blf") as bus:
        inner: Any = bus._adapter.bus
        monkeypatch.setattr(inner._node, "step", Mock(side_effect=FmuError("the FMU is on fire")))
        with pytest.raises(BusError, match="the FMU is on fire"):
            bus.sleep(1.0)


def test_only_the_frames_that_somebody_watches_wait() -> None:
    with opened(None, {HEAD_STATUS}) as bus:
        bus.sleep(0.3)
        assert {frame.arbitration_id for _, frame in bus.others} == {HEAD_STATUS}


def test_change_of_the_loop_is_sent_at_once_and_logged_after_what_came_before_it(tmp_path: Path) -> None:
    with opened(tmp_path / "it.blf") as bus:
        bus.send_keep_alive(Enables.NONE)
        bus.sleep(0.25)
        changed = bus.now()
        bus.send_job(8)
        bus.send([Frame(HEAD, ARE_YOU_THERE)])
        bus.sleep(0.005)
        enabled = bus.now()
        bus.send_keep_alive(Enables.GATE)
    logged = [frame for frame in can.BLFReader(tmp_path / "it.blf") if frame.arbitration_id in (MASTER_ALIVE, HEAD)]
    beats = [frame for frame in logged if frame.arbitration_id == MASTER_ALIVE]
    assert [frame.arbitration_id for frame in logged if frame.timestamp >= changed][:2] == [MASTER_ALIVE, HEAD]
    found = [(frame.timestamp, frame.data[1] >> 4, frame.data[4]) for frame in beats if frame.timestamp >= changed]
    moments = [(changed, 0, 8), (enabled, 2, 8), (enabled, 0, 8)]
    assert found == [pytest.approx((at + 1e-6, enables, job), rel=0.0, abs=1e-7) for at, enables, job in moments]

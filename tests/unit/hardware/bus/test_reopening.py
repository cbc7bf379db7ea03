"""Conditions for opening an adapter again, and others on the bus that keep everything disabled; without a bus."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from pathlib import Path

import can
import pytest

from inkloop_hardware.bus.adapter import Adapter, Reopening, has_carrier
from inkloop_hardware.bus.process import BusProcess
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusError, BusOff
from inkloop_hardware.link.node_watch import OVER_AFTER, BusWatch
from inkloop_hardware.protocol.records import MasterAlive, Source, StopRequest

GONE, OFF = BusError("gone."), BusOff("off.", 1.0)
OTHER = MasterAlive(False, False, False, session=5, job=1)


def test_pauses_grow_to_a_limit_and_end_with_a_message() -> None:
    again: list[float] = []
    tried = Reopening(limit_s=10.0).pauses(GONE, True, 0.0)
    with pytest.raises(BusError, match=r"gone\. It could not be opened again within 1\d s"):
        again.extend(tried)
    assert again == [0.1, 0.2, 0.4, 0.8, 1.6, *4 * [2.0]]


def test_adapter_that_is_bus_off_is_opened_once_in_a_run_and_never_with_the_lamp_on() -> None:
    reopening = Reopening(limit_s=10.0)
    assert next(reopening.pauses(OFF, False, 0.0)) == 1.0
    with pytest.raises(BusError, match="once already"):
        next(reopening.pauses(OFF, False, 1.0))
    assert next(reopening.pauses(GONE, False, 1.0)) == 0.1
    with pytest.raises(BusError, match="lamp was enabled"):
        next(Reopening(limit_s=10.0).pauses(OFF, True, 0.0))


def test_adapter_that_fails_again_soon_has_no_more_tries() -> None:
    reopening = Reopening(limit_s=1.0)
    pauses = []
    for now in range(4):
        pauses.append(next(reopening.pauses(GONE, False, float(now))))
        reopening.opened(float(now))
    assert pauses == [0.1, 0.2, 0.4, 0.8]
    for too_soon in (4.0, 13.0):
        with pytest.raises(BusError, match="could not be opened again within 2 s"):
            next(reopening.pauses(GONE, False, too_soon))
    assert next(reopening.pauses(GONE, False, 13.1)) == 0.1, "ten seconds after it was opened"


def test_another_master_is_one_that_is_heard_twice_and_not_for_long() -> None:
    watch = BusWatch(session=4)
    watch.take_master(0.0, OTHER)
    assert watch.other_master(0.0) is None, "the last word of a run that ended"
    watch.take_master(0.1, OTHER)
    assert "session 5" in (watch.other_master(0.1) or "")
    later = 0.1 + OVER_AFTER + 0.01
    assert watch.other_master(later) is None
    watch.take_master(later, OTHER)
    assert watch.other_master(later) is None, "again a single one"
    watch.take_master(later, replace(OTHER, session=6))
    watch.take_master(later, replace(OTHER, session=4))
    assert watch.other_master(later) is None, "a single one of each, and our own"
    watch.take_master(later, replace(OTHER, session=6))
    assert "session 6" in (watch.other_master(later) or "")


def test_stop_request_that_lasts_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    watch = BusWatch(session=4)
    for now, active in enumerate((True, True, False, True)):
        watch.take_stop(now / 10, StopRequest(active, Source.OPERATOR))
    assert caplog.messages == 2 * ["a stop request of the operator"]


def test_stop_request_lasts_until_it_is_released_or_silent() -> None:
    watch = BusWatch(session=4)
    watch.take_stop(0.0, StopRequest(True, Source.OPERATOR))
    assert "stop request of the operator" in (watch.stop_request(0.2) or "")
    assert watch.stop_request(OVER_AFTER + 0.01) is None
    watch.take_stop(1.0, StopRequest(True, Source.OPERATOR))
    watch.take_stop(1.1, StopRequest(False, Source.OPERATOR))
    assert watch.stop_request(1.1) is None


class Silent(can.BusABC):
    """Opens and reads without an error, as a SocketCAN socket on a controller that is bus-off."""

    def __init__(self) -> None:
        self.channel, self.channel_info = "can0", "silent"
        self._is_shutdown = True

    def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("nothing is sent here")


@pytest.mark.parametrize("is_on", [True, False])
def test_reopened_interface_counts_only_if_its_controller_is_on_the_bus(
    is_on: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Silent, "__module__", "can.interfaces.socketcan.socketcan")
    monkeypatch.setattr("inkloop_hardware.bus.adapter._open", lambda _: Silent())
    monkeypatch.setattr("inkloop_hardware.bus.adapter.has_carrier", lambda name: is_on or name != "can0")
    monkeypatch.setattr("inkloop_hardware.bus.process.PROOF", 0.0)
    process = BusProcess(BusSettings("socketcan", "can0"), 1, 1, None)  # type: ignore[arg-type]
    assert process._opened_again() is is_on


@pytest.mark.parametrize(("text", "expected"), [("0\n", False), ("1\n", True), ("\n", True), (None, True)])
def test_only_an_interface_that_says_so_has_no_carrier(text: str | None, expected: bool, tmp_path: Path) -> None:
    (tmp_path / "can0").mkdir()
    if text is not None:
        (tmp_path / "can0" / "carrier").write_text(text)
    assert has_carrier("can0", tmp_path) is expected


class Queued(Silent):
    """An adapter that has these messages."""

    def __init__(self, *messages: can.Message) -> None:
        super().__init__()
        self.left = deque(messages)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # type: ignore[override]
        return (self.left.popleft() if self.left else None), True


def error_frame(classes: int) -> can.Message:
    return can.Message(arbitration_id=classes, is_error_frame=True)


def test_error_frames_are_counted_and_bus_off_is_that_of_a_network_interface(monkeypatch: pytest.MonkeyPatch) -> None:
    """Others give error frames a meaning of their own. While frames come in, nobody asks for the carrier."""
    monkeypatch.setattr(Queued, "__module__", "can.interfaces.socketcan.socketcan")
    monkeypatch.setattr("inkloop_hardware.bus.adapter.has_carrier", lambda name: name != "can0")
    bus = Queued(error_frame(0x04), can.Message(), error_frame(0x88))
    adapter = Adapter(BusSettings("socketcan", "can0"), bus)
    assert len(adapter.receive(0.0)) == 3
    assert adapter.complaints() == {"frames sent again": 0, "error frames on the bus": 2}
    with pytest.raises(BusOff, match="can0 has no carrier: its controller is bus-off"):
        adapter.receive(0.0)
    bus.left.append(error_frame(0x44))
    with pytest.raises(BusOff, match=r"can0 is bus-off: too many errors.*sudo ip link set can0 type can restart"):
        adapter.receive(0.0)
    monkeypatch.undo()
    other = Adapter(BusSettings("pcan", "PCAN_USBBUS1"), Queued(error_frame(0x40)))
    assert len(other.receive(0.0)) == 1

"""State of a CAN controller in the kernel's answers, against the kernel's own headers where they are installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from struct import pack

import can
import pytest

from inkloop_hardware.bus import controller_state as module
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.controller_state import ControllerState, controller_state, state_in
from inkloop_hardware.bus.process import BusProcess
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusOff
from support import compiled

HEADERS = [Path("/usr/include/linux") / name for name in ("rtnetlink.h", "if_link.h", "can/netlink.h")]
PROGRAM = """
#include <linux/rtnetlink.h>
#include <linux/if_link.h>
#include <linux/can/netlink.h>
#include <stdio.h>
int main(void) {
    printf("%d %d %d %d %d %d %d %d %d %zu %zu", RTM_GETLINK, RTM_NEWLINK, NLM_F_REQUEST, IFLA_LINKINFO, IFLA_INFO_KIND,
           IFLA_INFO_DATA, IFLA_CAN_STATE, CAN_STATE_BUS_OFF, CAN_STATE_STOPPED, sizeof(struct nlmsghdr),
           sizeof(struct ifinfomsg));
    return 0;
}
"""


def attribute(number: int, value: bytes) -> bytes:
    return pack("=HH", 4 + len(value), number) + value + b"\0" * (-len(value) % 4)


def answer(kind: bytes, state: int, *, nested: int = 0) -> bytes:
    """As the kernel writes it; nested: the flag that newer kernels set on containers."""
    data = attribute(1, bytes(32)) + attribute(4, pack("=I", state)) + attribute(6, bytes(4))
    info = attribute(1, kind + b"\0") + attribute(2 | nested, data)
    rest = attribute(3, b"can0\0") + attribute(18 | nested, info) + attribute(16, b"\6")
    return pack("=IHHII", 32 + len(rest), 16, 0, 1, 0) + bytes(16) + rest


@pytest.mark.parametrize("nested", [0, 0x8000])
@pytest.mark.parametrize("state", list(ControllerState))
def test_state_is_found_in_the_answer(state: ControllerState, nested: int) -> None:
    assert state_in(answer(b"can", state, nested=nested)) is state


def test_answer_about_something_else_has_no_state() -> None:
    assert state_in(answer(b"vlan", 3)) is None, "attribute 4 of another kind is something else"
    assert state_in(answer(b"can", 77)) is None
    assert state_in(pack("=IHHIIi", 36, 2, 0, 1, 0, -19)) is None, "an error of the kernel"
    whole = answer(b"can", 3)
    for length in range(len(whole)):
        state_in(whole[:length])


@pytest.mark.skipif(sys.platform != "linux", reason="rtnetlink is of Linux")
def test_kernel_answers_about_an_interface_without_a_controller() -> None:
    assert controller_state("lo") is None
    assert controller_state("no-such-one") is None


@pytest.mark.compiled
@pytest.mark.skipif(not all(header.exists() for header in HEADERS), reason="the kernel's headers are not installed")
def test_numbers_are_those_of_the_kernel(tmp_path: Path) -> None:
    (tmp_path / "numbers.c").write_text(PROGRAM)
    program = compiled.program("numbers", [tmp_path / "numbers.c"], ())
    found = [int(word) for word in subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()]
    assert found == [
        *(module.GETLINK, module.NEWLINK, module.REQUEST, module.LINKINFO, module.INFO_KIND, module.INFO_DATA),
        *(module.CAN_STATE, ControllerState.BUS_OFF, ControllerState.STOPPED, module.HEAD.size, module.LINK.size),
    ]


class Silent(can.BusABC):
    """Opens and reads without an error, as a SocketCAN socket on a controller that is bus-off."""

    def __init__(self) -> None:
        self.channel_info = "silent"
        self._is_shutdown = True

    def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
        return None, False

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise can.CanOperationError("nothing is sent here")


@pytest.mark.parametrize("state", [None, *ControllerState])
def test_reopened_interface_counts_only_if_its_controller_is_on_the_bus(
    state: ControllerState | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = BusSettings("socketcan", "can0")
    monkeypatch.setattr(Silent, "__module__", "can.interfaces.socketcan.socketcan")
    monkeypatch.setattr("inkloop_hardware.bus.adapter._open", lambda _: Silent())
    monkeypatch.setattr("inkloop_hardware.bus.adapter.controller_state", lambda name: state if name == "can0" else None)
    monkeypatch.setattr("inkloop_hardware.bus.process.PROOF", 0.0)
    is_off = state in (ControllerState.BUS_OFF, ControllerState.STOPPED)
    process = BusProcess(settings, 1, 1, None)  # type: ignore[arg-type]
    assert process._opened_again() is not is_off
    if is_off:
        with pytest.raises(BusOff, match="type can restart"):
            Adapter(settings).check_controller()

"""State of a CAN controller, asked of the Linux kernel by rtnetlink.

A SocketCAN socket on a controller that is bus-off opens and reads without an error; only the kernel tells its state.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from enum import IntEnum
from struct import Struct

GETLINK, NEWLINK, REQUEST = 18, 16, 1
"""linux/rtnetlink.h, linux/netlink.h: RTM_GETLINK, RTM_NEWLINK, NLM_F_REQUEST."""
LINKINFO, INFO_KIND, INFO_DATA, CAN_STATE = 18, 1, 2, 4
"""linux/if_link.h, linux/can/netlink.h: IFLA_LINKINFO, IFLA_INFO_KIND, IFLA_INFO_DATA, IFLA_CAN_STATE."""
HEAD, LINK, ATTRIBUTE, WORD = Struct("=IHHII"), Struct("=BxHiII"), Struct("=HH"), Struct("=I")
TYPE_MASK, ALIGNMENT, ROOM = 0x3FFF, 4, 1 << 16
ANSWER_WITHIN = 1.0


class ControllerState(IntEnum):
    """enum can_state of linux/can/netlink.h."""

    ERROR_ACTIVE = 0
    ERROR_WARNING = 1
    ERROR_PASSIVE = 2
    BUS_OFF = 3
    STOPPED = 4
    SLEEPING = 5


def controller_state(interface: str) -> ControllerState | None:
    """State of the controller behind a network interface; None if it has none (vcan), or the kernel does not tell."""
    if not hasattr(socket, "AF_NETLINK"):
        return None
    try:
        link = LINK.pack(socket.AF_UNSPEC, 0, socket.if_nametoindex(interface), 0, 0)
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
            kernel.settimeout(ANSWER_WITHIN)
            kernel.send(HEAD.pack(HEAD.size + len(link), GETLINK, REQUEST, 1, os.getpid()) + link)
            return state_in(kernel.recv(ROOM))
    except OSError:
        return None


def state_in(answer: bytes) -> ControllerState | None:
    """The state in an answer to RTM_GETLINK; None if it holds none."""
    if len(answer) < HEAD.size or HEAD.unpack_from(answer)[1] != NEWLINK:
        return None
    kind, data = b"", b""
    for number, value in _attributes(answer[HEAD.size + LINK.size :]):
        if number == LINKINFO:
            inner = dict(_attributes(value))
            kind, data = inner.get(INFO_KIND, b""), inner.get(INFO_DATA, b"")
    state = dict(_attributes(data)).get(CAN_STATE, b"") if kind.rstrip(b"\0") == b"can" else b""
    number = WORD.unpack(state)[0] if len(state) == WORD.size else -1
    return ControllerState(number) if number in set(ControllerState) else None


def _attributes(data: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at + ATTRIBUTE.size <= len(data):
        length, number = ATTRIBUTE.unpack_from(data, at)
        if length < ATTRIBUTE.size:
            return
        yield number & TYPE_MASK, data[at + ATTRIBUTE.size : at + length]
        at += -(-length // ALIGNMENT) * ALIGNMENT

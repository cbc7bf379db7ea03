"""Errors of the bench, by what has to be corrected.

HardwareError
├── BusError             the adapter, a cable or the bus process failed; the message names interface and channel
│   ├── BusOff           the adapter has left the bus after too many errors
│   └── BusDisconnected  the adapter is missing and is being opened again
├── AnotherMaster        another master is active: nothing is enabled
├── StopRequested        a stop request is active: nothing is enabled
├── NodeLost             a node is silent, or its frames cannot be trusted
├── NodeStopped          a node went to SAFE or FAULT during a request; `fault` is the cause
├── NodeRefused          a node refused a request; `code` is its negative response code
├── LinkTimeout          a node is alive and does not answer a request
└── TransferError        a pattern or a map was not transferred completely
"""

from __future__ import annotations

from enum import IntEnum

from inkloop.errors import InkloopError


class FrameError(InkloopError):
    """A frame or a value does not fit the DBC; the message names both, and what would fit."""


class HardwareError(InkloopError):
    """Base of the errors between the master and the nodes of a bench."""


class BusError(HardwareError):
    """Adapter, cable or bus process failed."""


class BusOff(BusError):
    """The adapter does not send any more after too many errors on the bus; `since`: second of the monotonic clock."""

    def __init__(self, message: str, since: float) -> None:
        super().__init__(message)
        self.since = since


class BusDisconnected(BusError):
    """The adapter is missing at the moment; it is being opened again."""


class ReplayDiffers(BusError):
    """A replayed request differs from that of the recorded run."""


class ReplayEnded(BusError):
    """The recorded run of a replay ends here."""


class AnotherMaster(HardwareError):
    """Another master is active on the bus; nothing is enabled meanwhile."""


class StopRequested(HardwareError):
    """A stop request is active; nothing is enabled until it is released."""


class NodeLost(HardwareError):
    """A node is silent, or its frames cannot be trusted."""


class NodeStopped(HardwareError):
    """A node took its de-energised state during a request; `fault` is its cause, of `protocol.records.Fault`."""

    def __init__(self, message: str, fault: IntEnum) -> None:
        super().__init__(message)
        self.fault = fault


class NodeRefused(HardwareError):
    """A node refused a request; `code` is the negative response code of UDS (0x22, 0x24 ...)."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class LinkTimeout(HardwareError):
    """A request was not answered in any of its tries."""


class TransferError(HardwareError):
    """A pattern or a map did not arrive as it was sent."""

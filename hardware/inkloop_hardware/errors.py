"""Errors of the bench, split by who can mend them.

HardwareError
├── BusError        adapter, cable, bus process: the message names the interface and the channel
│   ├── BusOff      the adapter took itself off the bus: too many errors
│   └── BusAway     the adapter is gone, and is being opened again
├── NotAlone        another master speaks, or somebody asks for a stop: nothing is enabled
├── NodeLost        a node is silent or not to be believed
├── NodeStopped     a node fell to SAFE or FAULT in the middle of something; `fault` says why
├── NodeRefused     a node answered that it will not; `code` is its negative response code
├── LinkTimeout     a node is alive and does not answer a request
└── TransferError   a pattern or a map did not get across whole
"""

from __future__ import annotations

from enum import IntEnum

from inkloop.errors import InkloopError


class FrameError(InkloopError):
    """A frame or a value does not fit the DBC; the message names both and says what would."""


class HardwareError(InkloopError):
    """Anything that goes wrong between the master and the nodes of a bench."""


class BusError(HardwareError):
    """The bus cannot be opened or used any more."""


class BusOff(BusError):
    """The adapter does not send any more, because of too many errors on the bus; `since` a second of the monotonic
    clock."""

    def __init__(self, message: str, since: float) -> None:
        super().__init__(message)
        self.since = since


class BusAway(BusError):
    """The adapter is gone for the moment; it is being opened again."""


class ReplayDiffers(BusError):
    """In a replay: the master asks for something else than it did in the recorded run."""


class ReplayEnded(BusError):
    """In a replay: the recorded run has come no further."""


class NotAlone(HardwareError):
    """Another master, or somebody who asks for a stop, speaks on the bus."""


class NodeLost(HardwareError):
    """A node is silent, or its frames are not to be believed."""


class NodeStopped(HardwareError):
    """A node took its de-energised state during a request; `fault` is its cause, of `protocol.vocabulary.Fault`."""

    def __init__(self, message: str, fault: IntEnum) -> None:
        super().__init__(message)
        self.fault = fault


class NodeRefused(HardwareError):
    """A node will not do what it was asked; `code` is that of UDS (0x22, 0x24 ...)."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class LinkTimeout(HardwareError):
    """No answer to a request, in all its tries."""


class TransferError(HardwareError):
    """A pattern or a map did not arrive as it was sent."""

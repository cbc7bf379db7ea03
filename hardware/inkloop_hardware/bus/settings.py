"""Settings of a bus: its adapter, its traffic log, its time limits; and the lock on its channel.

The lock is for the programs of this machine: a mapped rig has no heartbeat that another master would hear, and a serial
port has one reader. The system takes it back when the process that holds it ends, however it ends; the file stays.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from can.util import load_config

from inkloop.files import opened_lock, reason_of, sign_lock, signature, take_lock
from inkloop.units import KILO
from inkloop_hardware.bus.fmu_bus import INTERFACE as FMU
from inkloop_hardware.errors import AnotherMaster, BusError

ON_SERIAL_PORTS = ("slcan", "serial", "robotell", "seeedstudio")
"""Interfaces of python-can whose channel is a serial port."""


@dataclass(frozen=True)
class BusSettings:
    """An adapter as python-can knows it, the traffic log, and how long the control loop may be silent.

    interface, channel, bitrate (bit/s): those of `can.Bus`; python-can looks up None in its own configuration
    (environment, ~/.canrc, can.ini). options: further arguments of that interface. fd: CAN FD frames are sent and
    received; data_bitrate (bit/s): of their data; bit_rate_switch: sent ones use it. traffic_log: file of all frames,
    BLF or ASC by its suffix; a relative one lies in the folder of the rig; None: none. loop_timeout_s: seconds that the
    control loop may be busy (a plan) while nothing is enabled, then the heartbeat ends; grace_s: the same while
    something is enabled. reopen_s: seconds of tries to open a disconnected adapter. answer_s: seconds for a node to
    begin an answer; silence_s: seconds without a status until a node is lost, and without another master before this
    one begins.
    """

    interface: str | None = None
    channel: str | int | None = None
    bitrate: int | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    traffic_log: Path | None = None
    loop_timeout_s: float = 120.0
    grace_s: float = 0.5
    reopen_s: float = 10.0
    answer_s: float = 1.0
    silence_s: float = 0.3
    fd: bool = False
    data_bitrate: int | None = None
    bit_rate_switch: bool = False

    def __str__(self) -> str:
        """Name in messages: "slcan on /dev/ttyACM0 at 500 kbit/s"."""
        name = self.interface or "the interface of python-can's configuration"
        if self.channel is not None:
            name += f" on {self.channel}"
        return name + (f" at {self.bitrate / KILO:g} kbit/s" if self.bitrate else "")

    @property
    def has_one_reader(self) -> bool:
        """Whether a second program that opens the adapter takes frames from the first, and opens it anew."""
        return self.interface in ON_SERIAL_PORTS and "://" not in str(self.channel)

    def arguments(self) -> dict[str, Any]:
        """Those of `can.Bus`."""
        given = {"interface": self.interface, "channel": self.channel, "bitrate": self.bitrate}
        given |= {"fd": self.fd or None, "data_bitrate": self.data_bitrate}
        return {name: value for name, value in given.items() if value is not None} | dict(self.options)

    def to_json(self) -> str:
        """For another process; TypeError for an option that JSON does not know."""
        return json.dumps(asdict(self) | {"traffic_log": str(self.traffic_log) if self.traffic_log else None})

    @classmethod
    def from_json(cls, text: str) -> BusSettings:
        """The settings that `to_json` wrote."""
        found = json.loads(text)
        return cls(**found | {"traffic_log": Path(found["traffic_log"]) if found["traffic_log"] else None})


UNSIGNED = "a process of this machine"


def interface_of(settings: BusSettings) -> str | None:
    """The interface of the settings, else that of python-can's own configuration; None if both name none."""
    if settings.interface is not None:
        return settings.interface
    try:
        return str(load_config(config=settings.arguments())["interface"])
    except NotImplementedError as error:  # it knows no such interface; none, or one of its own configuration
        named = str(error).rpartition(" ")[2].strip('"')
        return None if named == "None" else named


def lock_channel(settings: BusSettings) -> Callable[[], None]:
    """Lock the channel of these settings; returns what releases it.

    AnotherMaster if another process of this machine holds it; BusError if its file cannot be written.
    """
    if interface_of(settings) == FMU:  # each opening is a bench of its own
        return lambda: None
    path = _path(settings)
    file = _opened(path)
    try:
        if not take_lock(file):
            raise AnotherMaster(
                f"{settings}: another inkloop prints there ({signature(file) or UNSIGNED}); nothing "
                "was sent. Wait until it ends, or stop it"
            )
        with suppress(OSError):  # the file of another user
            os.fchmod(file, 0o666)
        sign_lock(file)
    except OSError as error:
        os.close(file)
        raise _error(path, error) from error
    except AnotherMaster:
        os.close(file)
        raise
    return lambda: os.close(file)


def holder(settings: BusSettings) -> str | None:
    """The process that has locked the channel of these settings, None if it is free; not for a process that has it.

    BusError if its file cannot be read.
    """
    path = _path(settings)
    if not path.exists():
        return None
    file = _opened(path)
    try:
        return None if take_lock(file) else signature(file) or UNSIGNED
    except OSError as error:
        raise _error(path, error) from error
    finally:
        os.close(file)


def _opened(path: Path) -> int:
    """The file of a lock; one of another user is not created anew: systems refuse that in the folder of everybody."""
    try:
        with suppress(FileNotFoundError):
            return opened_lock(path)
        return opened_lock(path, 0o666)
    except OSError as error:
        raise _error(path, error) from error


def _error(path: Path, error: OSError) -> BusError:
    return BusError(
        f"{path}: the channel cannot be locked: {reason_of(error)}; remove what is there, or let this user write it"
    )


def _path(settings: BusSettings) -> Path:
    """A file for each channel, by what python-can is given, without bit rates."""
    place = (settings.interface, settings.channel, sorted((key, str(value)) for key, value in settings.options.items()))
    name = hashlib.sha256(repr(place).encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"inkloop-channel-{name}.lock"

"""Lock on a channel for the programs of this machine: a mapped rig has no heartbeat that another master would hear,
and a serial port has one reader.

The system takes the lock back when the process that holds it ends, however it ends; the file stays.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from inkloop.files import sign_lock, signature, take_lock
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import AnotherMaster, BusError

UNSIGNED = "a process of this machine"
NO_LINK = getattr(os, "O_NOFOLLOW", 0)
"""The folder is everybody's: a link that lies there is not followed."""


def lock_channel(settings: BusSettings) -> Callable[[], None]:
    """Lock the channel of these settings; returns what releases it.

    AnotherMaster if another process of this machine holds it; BusError if its file cannot be written.
    """
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
    try:
        return os.open(path, os.O_RDWR | os.O_CREAT | NO_LINK, 0o666)
    except OSError as error:
        raise _error(path, error) from error


def _error(path: Path, error: OSError) -> BusError:
    reason = error.strerror or error
    return BusError(f"{path}: the channel cannot be locked: {reason}; remove what is there, or let this user write it")


def _path(settings: BusSettings) -> Path:
    """A file for each channel, by what python-can is given, without bit rates."""
    place = (settings.interface, settings.channel, sorted((key, str(value)) for key, value in settings.options.items()))
    name = hashlib.sha256(repr(place).encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"inkloop-channel-{name}.lock"

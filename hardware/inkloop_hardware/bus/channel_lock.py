"""Lock on a channel for the programs of this machine: a mapped rig has no heartbeat that another master would hear.

The system takes the lock back when the process that holds it ends, however it ends; the file stays.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from inkloop.files import take_lock
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import AnotherMaster, BusError


def lock_channel(settings: BusSettings) -> Callable[[], None]:
    """Lock the channel of these settings; returns what releases it.

    AnotherMaster if another process of this machine holds it; BusError if its file cannot be written.
    """
    path = _path(settings)
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        with suppress(OSError):  # the file of another user
            path.chmod(0o666)
        if not take_lock(file):
            words = os.read(file, 100).decode(errors="replace")
            os.close(file)
            raise AnotherMaster(
                f"{settings}: another inkloop prints there ({words or 'a process of this machine'}); nothing was sent. "
                "Wait until it ends, or stop it"
            )
        os.ftruncate(file, 0)
        os.write(file, f"process {os.getpid()} since {time.strftime('%Y-%m-%d %H:%M:%S')}".encode())
    except OSError as error:
        raise BusError(f"{path}: the channel cannot be locked: {error.strerror or error}") from error
    return lambda: os.close(file)


def _path(settings: BusSettings) -> Path:
    """A file for each channel, by what python-can is given, without bit rates."""
    place = (settings.interface, settings.channel, sorted((key, str(value)) for key, value in settings.options.items()))
    name = hashlib.sha256(repr(place).encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"inkloop-channel-{name}.lock"

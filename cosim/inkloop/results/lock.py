"""Exclusive lock on a run folder; a second writer gets the owner's process id.

The system keeps the lock for the process that took it and takes it back when that ends, however it ends: after a kill
there is nothing to clean up. Processes that it has started do not have it.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from inkloop.errors import ResultError
from inkloop.files import opened_lock, reason_of, sign_lock, signature, take_lock

__all__ = ["sole_writer", "writer_of"]

LOCK_FILE = "run.lock"
"""File that names the process writing into a run folder; a file left by a killed process has no effect."""
_NO_LOCKS = (errno.ENOLCK, errno.ENOTSUP)  # of a file system that keeps none: no reason not to print


@contextmanager
def sole_writer(folder: Path) -> Iterator[None]:
    """No other process writes a run into `folder` during the block; the folder is made, and goes if it stays empty.

    Raises ResultError if another process does, naming it, or if the folder cannot be written.
    """
    path = folder / LOCK_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = _locked(path)
        sign_lock(file)
    except OSError as error:
        raise ResultError(f"{folder}: the run cannot be written there: {reason_of(error)}") from error
    try:
        yield
    finally:
        _release(file, path)
        if not any(folder.iterdir()):
            folder.rmdir()


def writer_of(folder: Path) -> str:
    """The process other than this one that writes a run into `folder`, as it signed; "" if there is none.

    Not for a folder that this process has locked: the system releases a lock when any of its files is closed.
    """
    try:
        file = opened_lock(folder / LOCK_FILE)
    except OSError:
        return ""
    try:
        return "" if take_lock(file) else signature(file) or "another process"
    except OSError:
        return ""  # a file system without locks
    finally:
        os.close(file)


def _locked(path: Path) -> int:
    """The open lock file, with the lock. Raises ResultError if another process has it, OSError."""
    while True:
        file = opened_lock(path, 0o644)
        if not _take(file):
            words = signature(file)
            os.close(file)
            raise ResultError(
                f"{path.parent}: another run writes here{f', {words}' if words else ''}; wait until it ends, or stop "
                f"it and continue with `inkloop resume {path.parent}`"
            )
        with suppress(FileNotFoundError):
            if os.path.samestat(path.stat(), os.fstat(file)):
                return file
        os.close(file)  # the previous owner has just removed the file


def _take(file: int) -> bool:
    """Take the lock of an open file; False if another process has it. Raises OSError."""
    try:
        return take_lock(file)
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        return True


def _release(file: int, path: Path) -> None:
    """Remove the lock file, then release the lock, so that no other process locks a removed file."""
    if sys.platform == "win32":  # where open files cannot be removed
        os.close(file)
        with suppress(PermissionError):
            path.unlink(missing_ok=True)
        return
    path.unlink(missing_ok=True)
    os.close(file)

"""Files that are there whole or not at all, locks, temporary folders, libraries of C code, reasons of failed writes."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import sys
import sysconfig
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.resources import files
from pathlib import Path
from typing import Any

from inkloop.errors import InkloopError

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

OWNER_FILE = "owner.lock"
"""File of a temporary folder that its process has locked: once the process has ended, it can be locked by another."""
_FAR = 1 << 30  # locked is a byte beyond the content: where locks keep readers out too (Windows), it can be read
_FULL = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file becomes larger than the disk or a limit (ulimit -f) allows",
}


@contextmanager
def replaced(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """A temporary name in the same folder, renamed to `path` when the block ends well, removed when it fails.

    durable: when the block has ended well, not even a power failure takes the file back. An OSError names `path`.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        yield partial
        if durable:
            with partial.open("rb+") as file:
                os.fsync(file.fileno())
        partial.replace(path)
        if durable:
            sync_folder(path.parent)
    except OSError as error:
        if error.filename in (None, str(partial)):
            error.filename = str(path)
        raise
    finally:
        partial.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Have the disk know which files a folder holds; where folders cannot be synced (Windows) the system sees to it."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str, *, durable: bool = False) -> None:
    """Write a UTF-8 text whole or not at all; durable: see `replaced`."""
    with replaced(path, durable=durable) as partial:
        partial.write_text(text, encoding="utf-8")


def reason_of(error: OSError) -> str:
    """Why a file cannot be read or written; a full disk is named as that."""
    return _FULL.get(error.errno or 0) or error.strerror or str(error)


def is_full(error: OSError) -> bool:
    """Whether there is no room for what was to be written."""
    return error.errno in _FULL


def take_lock(file: int) -> bool:
    """Lock an open file for this process; False if another one has it. Raises OSError, also without locks there."""
    try:
        if sys.platform == "win32":
            os.lseek(file, _FAR, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        else:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _FAR)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            raise
        return False
    finally:
        os.lseek(file, 0, os.SEEK_SET)
    return True


@contextmanager
def temporary_folder(purpose: str) -> Iterator[Path]:
    """An empty folder for the block, removed at its end; those of processes that were killed are removed first."""
    remove_abandoned(Path(tempfile.gettempdir()))
    with tempfile.TemporaryDirectory(prefix=f"inkloop-{purpose}-{os.getpid()}-") as name:
        owner = _owned(Path(name))
        try:
            content = Path(name) / "content"
            content.mkdir()
            yield content
        finally:
            os.close(owner)


def remove_abandoned(place: Path) -> list[Path]:
    """Remove temporary folders in `place` whose process has ended without doing so; returns them."""
    removed = []
    for folder in place.glob("inkloop-*-*-*"):
        if folder.name.split("-")[-2] == str(os.getpid()):  # to open and close the file would release its lock
            continue
        with suppress(OSError):  # of another user, without locks, or being removed
            file = os.open(folder / OWNER_FILE, os.O_RDWR)
            try:
                is_abandoned = take_lock(file)
            finally:
                os.close(file)
            if is_abandoned:
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


def _owned(folder: Path) -> int:
    """The lock of a new temporary folder, which gets its name when it is locked."""
    partial = folder / f".{OWNER_FILE}"
    file = os.open(partial, os.O_RDWR | os.O_CREAT, 0o600)
    with suppress(OSError):  # a file system without locks: the folder is never taken for an abandoned one
        take_lock(file)
        partial.replace(folder / OWNER_FILE)
    return file


def c_library(
    package: str, name: str, variable: str, interface: int, entry_points: Mapping[str, tuple[Any, tuple[Any, ...]]]
) -> ctypes.CDLL:
    """A library of C code that is installed next to the modules of `package`, with its functions declared.

    variable: of the environment, which may name another file; interface: what its function `<name>_interface` returns;
    entry_points: function -> types of its result and arguments. Raises InkloopError if the library is not installed,
    cannot be loaded or was built from other sources.
    """
    path = _library_path(package, name, variable)
    try:
        library = ctypes.CDLL(str(path))
        for function_name, (result, arguments) in {**entry_points, f"{name}_interface": (ctypes.c_int32, ())}.items():
            function = getattr(library, function_name)
            function.restype, function.argtypes = result, arguments
    except (OSError, AttributeError) as error:
        raise InkloopError(f"{path}: is not {name} of this inkloop ({error}); install inkloop again") from error
    if getattr(library, f"{name}_interface")() != interface:
        raise InkloopError(
            f"{path}: was built from other sources than this Python code; run make, or pip install again"
        )
    return library


def _library_path(package: str, name: str, variable: str) -> Path:
    """An editable install leaves the sources in place and puts built files next to NumPy."""
    named = os.environ.get(variable)
    if named:
        if not Path(named).is_file():
            raise InkloopError(f"{variable} is {named!r}: no such file; unset it to take the installed library")
        return Path(named)
    suffixes = {"win32": ".dll", "darwin": ".dylib"}
    file_name = ("" if sys.platform == "win32" else "lib") + name + suffixes.get(sys.platform, ".so")
    own = files(package)
    folders = [own] if isinstance(own, Path) else []
    folders += [Path(sysconfig.get_path(scheme), *package.split(".")) for scheme in ("platlib", "purelib")]
    places = [folder / file_name for folder in folders]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        looked = ", ".join(str(place) for place in places)
        raise InkloopError(f"{name} is not installed (looked for {looked}); run make, or pip install inkloop")
    return found

"""Files: written whole or not at all, TOML with errors that name the line, locks, temporary folders, C libraries."""

from __future__ import annotations

import codecs
import ctypes
import errno
import os
import re
import shutil
import stat
import sys
import sysconfig
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from inkloop.errors import InkloopError, decimal_comma

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

RUNS = Path("runs")
"""Folder of run folders without --out."""
OWNER_FILE = "owner.lock"
"""File of a temporary folder, locked by its process: once the process has ended, another can lock it."""
_FOLDER = "inkloop-"
_FAR = 1 << 30  # the locked byte lies beyond the content, which stays readable where locks keep readers out (Windows)
_OWN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)  # Windows makes links for administrators only
_FULL = {
    errno.ENOSPC: "the disk is full",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file becomes larger than the disk or a limit (ulimit -f) allows",
}


_VALUE = re.compile(r"=\s*([^\s=#}\]]+?)\s*(?:$|[#}]|(?=,\s*\w+\s*=))")
"""A value in a line of TOML, up to the end of the line, of its table, or to the next key."""
_KINDS = {
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}


def regular(path: Path) -> Path:
    """The path, for one that reads it. Raises OSError where no file is, or something that can be read for ever."""
    if kind := _KINDS.get(stat.S_IFMT(path.stat().st_mode)):
        error = errno.EISDIR if kind == "a folder" else errno.EINVAL
        raise OSError(error, f"it is {kind}; name a file", str(path))
    return path


@contextmanager
def replaced(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """A name in a temporary folder next to `path`, renamed to `path` when the block ends well, removed when it fails.

    Nobody else writes into that folder: no link can lie under the name. The folder of `path` is made if it is missing.
    durable: once the block has ended well, the file survives a power failure. An OSError names `path`.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = "a file is in the way" if isinstance(error, FileExistsError | NotADirectoryError) else reason_of(error)
        raise OSError(error.errno, f"its folder cannot be made: {reason}; name another place", str(path)) from error
    try:
        _remove_abandoned_once(path.parent)
        with _private_folder("part", path.parent) as folder:
            partial = folder / f"_{path.name}"  # never that of the owner
            yield partial
            if durable:
                with partial.open("rb+") as file:
                    os.fsync(file.fileno())
            partial.replace(path)
            if durable:
                sync_folder(path.parent)
    except OSError as error:
        if error.filename is None or f"{_FOLDER}part-" in str(error.filename):
            error.filename = str(path)
        raise


def sync_folder(folder: Path) -> None:
    """Sync the entries of a folder to the disk; where folders cannot be synced (Windows) the system does it."""
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


class TomlError(ValueError):
    """A file or a text is not TOML; the message names the line, what it holds and what to do."""


def read_toml_text(path: Path) -> str:
    """The text of a TOML file, without the byte order mark that some editors write. Raises OSError, TomlError."""
    content = regular(path).read_bytes()
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise TomlError("is not TOML: the file is UTF-16; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line, byte = content.count(b"\n", 0, error.start) + 1, content[error.start : error.start + 1]
        raise TomlError(
            f"is not TOML: line {line} is not UTF-8; byte 0x{byte.hex()} is {byte.decode('cp1252', 'replace')!r} in an "
            "older encoding of Windows; save the file as UTF-8"
        ) from error


def toml_tables(text: str) -> dict[str, Any]:
    """The tables of a TOML text. Raises TomlError."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        lines = text.splitlines()
        found = re.search(r" \(at (?:line (\d+), column \d+|end of document)\)$", str(error))
        number = int(found[1]) if found and found[1] else len(lines)
        line, reason = lines[number - 1].strip(), str(error)[: found.start() if found else None]
        key = line.partition("=")[0].strip()
        odd = next((letter for letter in key if not letter.isascii()), None)
        if odd and '"' not in key:
            advice = "write um" if odd in "µμ" else "keys have the letters a to z, digits, _ and -"
            reason = f"a key without quotes has no {odd!r}; {advice}"
        elif reason.startswith("Cannot"):  # declare twice, overwrite a value, mutate
            reason = "this key or table is there already; keep one of them"
        elif advice := next(filter(None, map(decimal_comma, _VALUE.findall(line))), ""):
            reason = advice
        elif reason == "Invalid value":
            reason = f'a value is a number, true, false, [...] or a text in quotes: {key} = "..."'
        raise TomlError(f"is not TOML: line {number}, `{line}`: {reason}") from error
    except (ValueError, RecursionError) as error:  # a number of thousands of digits; lists in lists in lists
        raise TomlError(f"is not TOML that can be read: {error}") from error


def reason_of(error: OSError | MemoryError) -> str:
    """The reason why a file cannot be read or written, with names for links, a full disk and exhausted memory."""
    if isinstance(error, MemoryError):
        return "the memory is exhausted; take fewer cells or threads, or close other programs"
    if error.errno == errno.ELOOP:
        return "a link lies there, which is not followed"
    return _FULL.get(error.errno or 0) or error.strerror or str(error)


def is_full(error: OSError) -> bool:
    """Whether the error says that disk or memory is full."""
    return error.errno in _FULL


def opened_lock(path: Path, mode: int | None = None) -> int:
    """A file to be locked, open for reading and writing; mode: of one that is made where there is none.

    A link is not followed: others can write where it lies, and closing the file that it names would release a lock of
    this process on that file. Raises OSError.
    """
    return os.open(path, os.O_RDWR | _OWN) if mode is None else os.open(path, os.O_RDWR | _OWN | os.O_CREAT, mode)


def open_own(path: Path | str, mode: str, **options: Any) -> Any:
    """`open` of a file to which this program alone appends: a link is not followed, a pipe not awaited."""
    return open(path, mode, opener=lambda name, flags: os.open(name, flags | _OWN, 0o666), **options)


def take_lock(file: int) -> bool:
    """Lock an open file for this process; False if another one has it. Raises OSError, also if the file system has no
    locks.
    """
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


def sign_lock(file: int) -> None:
    """Write into a locked file which process has it, for those that are refused."""
    os.ftruncate(file, 0)
    os.write(file, f"process {os.getpid()} since {time.strftime('%Y-%m-%d %H:%M:%S')}".encode())


def signature(file: int) -> str:
    """The process that has a lock, as it signed; "" if it has not yet."""
    return os.read(file, 100).decode(errors="replace")


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder next to `path`, renamed to it when the block ends well, removed when it fails.

    Raises FileExistsError if `path` exists before or after the block.
    """
    _check_free(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with temporary_folder("new", path.parent) as content:
        yield content
        _check_free(path)
        content.rename(path)


@contextmanager
def temporary_folder(purpose: str, place: Path | None = None) -> Iterator[Path]:
    """An empty folder for the block, removed at its end; those of processes that were killed are removed first.

    place: folder that it is in; None: the system's for temporary files.
    """
    place = Path(tempfile.gettempdir()) if place is None else place
    remove_abandoned(place)
    with _private_folder(purpose, place) as folder:
        content = folder / "content"
        content.mkdir()
        yield content


@contextmanager
def _private_folder(purpose: str, place: Path) -> Iterator[Path]:
    """A folder of this user alone, with the file that tells whether its process lives."""
    with tempfile.TemporaryDirectory(prefix=f"{_FOLDER}{purpose}-{os.getpid()}-", dir=place) as name:
        owner = _owned(Path(name))
        try:
            yield Path(name)
        finally:
            os.close(owner)


@cache
def _remove_abandoned_once(place: Path) -> None:
    """For files that are written often: the folder is looked through once by a process."""
    remove_abandoned(place)


def remove_abandoned(place: Path) -> list[Path]:
    """Remove temporary folders in `place` whose process has ended without doing so; returns them."""
    removed = []
    for folder in place.glob(f"{_FOLDER}*-*-*"):
        if folder.name.split("-")[-2] == str(os.getpid()):  # to open and close the file would release its lock
            continue
        with suppress(OSError):  # of another user, without locks, or being removed
            file = opened_lock(folder / OWNER_FILE)
            try:
                is_abandoned = take_lock(file)
            finally:
                os.close(file)
            if is_abandoned:
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


def _check_free(path: Path) -> None:
    if path.exists():
        raise FileExistsError(errno.EEXIST, "is there already; name another place, or remove it", str(path))


def _owned(folder: Path) -> int:
    """The lock of a new temporary folder, which gets its final name once it is locked."""
    partial = folder / f".{OWNER_FILE}"
    file = opened_lock(partial, 0o600)
    with suppress(OSError):  # a file system without locks: the folder is never taken for an abandoned one
        take_lock(file)
        partial.replace(folder / OWNER_FILE)
    return file


def c_library(
    package: str, name: str, variable: str, interface: int, entry_points: Mapping[str, tuple[Any, tuple[Any, ...]]]
) -> ctypes.CDLL:
    """A library of C code that is installed next to the modules of `package`, with its functions declared.

    variable: of the environment, which may name another file; interface: expected value of its function
    `<name>_interface`; entry_points: function -> types of its result and arguments. Raises InkloopError if the library
    is not installed, cannot be loaded or was built from other sources.
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


def installed_file(package: str, name: str) -> Path:
    """A file that the build makes or installs next to the modules of `package`. Raises InkloopError if it is missing.

    An editable install leaves the sources in place and puts built files next to NumPy.
    """
    own = files(package)
    folders = [own] if isinstance(own, Path) else []
    folders += [Path(sysconfig.get_path(scheme), *package.split(".")) for scheme in ("platlib", "purelib")]
    places = [folder / name for folder in folders]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        looked = ", ".join(str(place) for place in places)
        raise InkloopError(f"{name} is not installed (looked for {looked}); run make, or pip install inkloop")
    return found


def _library_path(package: str, name: str, variable: str) -> Path:
    """The library that the environment names, else the installed one."""
    named = os.environ.get(variable)
    if named:
        if not Path(named).is_file():
            raise InkloopError(f"{variable} is {named!r}: no such file; unset it to take the installed library")
        return Path(named)
    prefix, suffix = {"win32": ("", ".dll"), "darwin": ("lib", ".dylib")}.get(sys.platform, ("lib", ".so"))
    return installed_file(package, f"{prefix}{name}{suffix}")

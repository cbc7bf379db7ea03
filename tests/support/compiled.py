"""What the tests compile: every object, library and program once per test run, whatever number of workers asks for it.

A test that uses it has the mark `compiled`.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from support import once_per_run

unmarked_test = ""
"""The test that runs, where it is not marked `compiled`; tests/conftest.py sets it."""
Word = str | Path


def once(make: Callable[..., object], *key: object) -> Path:
    """`once_per_run.once` for what a compiler makes."""
    if unmarked_test:
        pytest.fail(f"{unmarked_test} compiles: mark it with pytest.mark.compiled")
    return once_per_run.once(make, *key)


def run(command: Sequence[Word]) -> None:
    """Raises RuntimeError with what the command wrote."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))} failed:\n{done.stderr}")


def _compile(folder: Path, source: Path, flags: tuple[Word, ...], compiler: str) -> None:
    run([compiler, *flags, "-c", source, "-o", folder / f"{source.stem}.o"])


def _link(folder: Path, name: str, objects: tuple[Path, ...], flags: tuple[Word, ...], compiler: str) -> None:
    run([compiler, *objects, *flags, "-lm", "-o", folder / name])


def object_of(source: Path, flags: Sequence[Word], compiler: str = "gcc") -> Path:
    """The object file of one source."""
    return once(_compile, source, tuple(flags), compiler) / f"{source.stem}.o"


def linked(name: str, objects: Sequence[Path], flags: Sequence[Word] = (), compiler: str = "gcc") -> Path:
    """A program or, with `-shared`, a library of these objects."""
    return once(_link, name, tuple(objects), tuple(flags), compiler) / name


def program(name: str, sources: Sequence[Path], flags: Sequence[Word]) -> Path:
    """A program of these sources, all compiled and linked with the same flags."""
    return linked(name, [object_of(source, flags) for source in sources], flags)


def library(name: str, sources: Sequence[Path], flags: Sequence[Word]) -> ctypes.CDLL:
    """A shared library of these sources, loaded."""
    flags = (*flags, "-fPIC")
    return ctypes.CDLL(str(linked(name, [object_of(source, flags) for source in sources], (*flags, "-shared"))))


def sanitizer_libraries() -> str | None:
    """What Python has to load first: gcc's address sanitizer, and libstdc++, whose exceptions it looks after."""
    if sys.platform != "linux" or not shutil.which("gcc"):
        return None
    paths = []
    for name in ("libasan.so", "libstdc++.so.6"):
        output = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        paths.append(Path(output.strip()))
    return " ".join(map(str, paths)) if all(path.is_absolute() and path.exists() for path in paths) else None

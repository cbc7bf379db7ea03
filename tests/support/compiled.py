"""Compiled libraries and programs of the tests: each once per test run, for any number of workers.

Objects are kept in build/ from run to run, by the text of their source and of all headers that it can include, the
flags and the version of the compiler; `make clean` removes them. A test that uses it has the mark `compiled`.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path

import pytest

from support import once_per_run
from support.places import ROOT

unmarked_test = ""
"""The test that runs, where it is not marked `compiled`; tests/conftest.py sets it."""
Word = str | Path
KEPT = ROOT / "build" / "test-objects"
HEADERS_FOLLOW = ("-I", "-isystem")
EXACT = ("-ffp-contract=off", "-fno-trapping-math", "-fno-math-errno")
"""The flags of the build for which clones give the bits of the plain loops."""
BUILDS: dict[str, tuple[str, ...]] = {
    "as shipped": ("-O3", *EXACT),
    "without clones": ("-O3", *EXACT, "-DINKLOOP_BASELINE"),
    "of an importer": ("-O2",),
    "not optimised": ("-O0", "-DINKLOOP_BASELINE"),
}
"""Flags by which loops with clones are compared."""


def once(make: Callable[..., object], *key: object) -> Path:
    """`once_per_run.once` for what a compiler makes."""
    if unmarked_test:
        pytest.fail(f"{unmarked_test} compiles: mark it with pytest.mark.compiled")
    return once_per_run.once(make, *key)


def run(command: Sequence[Word]) -> None:
    """Raises RuntimeError with the output of the command."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(map(str, command))} failed:\n{done.stderr}")


@cache
def _version(compiler: str) -> str:
    return subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout


@cache
def _headers(folder: Path) -> str:
    """Text of the headers of a folder."""
    texts = (f"{path.name}\0{path.read_text(encoding='utf-8')}\0" for path in sorted(folder.glob("*.h")))
    return hashlib.sha256("".join(texts).encode()).hexdigest()


def _contents(source: Path, flags: tuple[Word, ...]) -> Iterator[str]:
    """Everything that an object depends on; a folder of headers counts by its content, not its place."""
    yield source.name
    yield source.read_text(encoding="utf-8")
    yield _headers(source.parent)
    for flag in map(str, flags):
        (mark,) = [mark for mark in HEADERS_FOLLOW if flag.startswith(mark)] or [""]
        yield f"{mark}{_headers(Path(flag.removeprefix(mark)))}" if mark else flag


def compile_kept(source: Path, made: Path, flags: tuple[Word, ...], compiler: str) -> None:
    """Compile a source to an object file, or copy that of an earlier run with the same contents."""
    words = "\0".join([_version(compiler), *_contents(source, flags)])
    kept = KEPT / f"{hashlib.sha256(words.encode()).hexdigest()}.o"
    if not kept.exists():
        run([compiler, *flags, "-c", source, "-o", made])
        KEPT.mkdir(parents=True, exist_ok=True)
        new = kept.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
        shutil.copyfile(made, new)
        new.replace(kept)
    shutil.copyfile(kept, made)


def _compile(folder: Path, source: Path, flags: tuple[Word, ...], compiler: str) -> None:
    compile_kept(source, folder / f"{source.stem}.o", flags, compiler)


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
    """Libraries that Python has to load first: gcc's address sanitizer, and libstdc++, whose exceptions it checks."""
    if sys.platform != "linux" or not shutil.which("gcc"):
        return None
    paths = []
    for name in ("libasan.so", "libstdc++.so.6"):
        output = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        paths.append(Path(output.strip()))
    return " ".join(map(str, paths)) if all(path.is_absolute() and path.exists() for path in paths) else None

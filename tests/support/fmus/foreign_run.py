"""An FMU's binary called from a small C program, here, in qemu-user or under Wine: tests/c/fmu_calls.c."""

from __future__ import annotations

import os
import shutil
import struct
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import fmpy

from inkloop.fmu_writer.export import compiler_command
from inkloop.fmu_writer.targets import Target
from support.places import C_SOURCES, ROOT

SOURCE = C_SOURCES / "fmu_calls.c"
VERSIONS = ROOT / "tests" / "fuzz" / "fmus"
HEADERS = Path(fmpy.__file__).parent / "c-code"
_DEBIAN = Path("/usr/lib/wine")  # where its package wine64 leaves the programs, out of the path
WINE = shutil.which("wine64", path=os.pathsep.join((os.environ.get("PATH", ""), str(_DEBIAN))))
QEMU = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
AARCH64_LIBRARIES = Path("/usr/aarch64-linux-gnu")  # of Debian's package libc6-arm64-cross
NAMES = {"real": ("Real", "Float64"), "integer": ("Integer", "Int32")}


def bits(value: float) -> str:
    """The 16 digits that fmu_calls takes for a number."""
    return struct.pack(">d", value).hex()


def numbers(text: str) -> list[float]:
    """Output of fmu_calls: 16 digits are the bits of a real, anything shorter an integer."""
    return [struct.unpack(">d", bytes.fromhex(line))[0] if len(line) == 16 else float(line) for line in text.split()]


def script_of(description: Any, values: Mapping[str, float], step_s: float, steps: int) -> str:
    """Set values of scalars, step, and ask for every output that is a number, after each step."""
    lines = []
    for variable in description.modelVariables:
        if variable.name in values:
            kind = next(kind for kind, types in NAMES.items() if variable.type in types)
            value = values[variable.name]
            lines.append(f"{kind} {variable.valueReference} 1 {bits(value) if kind == 'real' else int(value)}")
    asked = [
        f"{kind}s {variable.valueReference} {_size(description, variable)}"
        for variable in description.modelVariables
        for kind, types in NAMES.items()
        if variable.causality == "output" and variable.type in types and variable.name != "solve_time"
    ]
    for number in range(steps):
        lines += [f"step {bits(number * step_s)} {bits(step_s)}", *asked]
    at = next(k for k, line in enumerate(lines) if line.startswith("step"))
    return "\n".join([*lines[:at], "run", *lines[at:]]) + "\n"


def _size(description: Any, variable: Any) -> int:
    """Length of an output in numbers, with structural parameters at their start values."""
    starts = {v.valueReference: v.start for v in description.modelVariables}
    count = 1
    for dimension in variable.dimensions:
        count *= int(dimension.start or starts[dimension.valueReference])
    return count


def compiled(target: Target | None, out: Path) -> Path:
    """The calling program, made by gcc for this machine or by zig for a target."""
    flags = ("-std=c11", "-s", "-Wall", "-Wextra", "-Wpedantic", "-Werror", f"-I{VERSIONS}", "-isystem", HEADERS)
    compiler = ["gcc"] if target is None else [*compiler_command(), "cc", "-target", target.triple]
    libraries = ["-ldl", "-lm"] if target is None or target.system == "Linux" else []
    sources = [SOURCE, *(VERSIONS / f"version_{fmi}.c" for fmi in (2, 3))]
    subprocess.run([*compiler, *flags, "-o", out, *sources, *libraries], check=True)
    return out


def answers(command: Sequence[str | Path], script: str, environment: Mapping[str, str]) -> str:
    """Output of the program; raises RuntimeError with its message if a call fails."""
    words = [str(word) for word in command]
    done = subprocess.run(words, input=script, capture_output=True, text=True, env={**environment}, check=False)
    if done.returncode != 0:
        raise RuntimeError(done.stderr)
    return done.stdout.replace("\r", "")


@contextmanager
def wine_in(folder: Path) -> Iterator[dict[str, str]]:
    """The environment of a separate Wine, whose server is stopped afterwards."""
    environment = {**os.environ, "WINEPREFIX": str(folder), "WINEDEBUG": "-all", "WINEDLLOVERRIDES": "mscoree,mshtml="}
    assert WINE
    try:
        yield environment
    finally:
        server = shutil.which("wineserver", path=os.pathsep.join((str(Path(WINE).parent), os.environ.get("PATH", ""))))
        if server:
            subprocess.run([server, "-k"], env=environment, check=False)

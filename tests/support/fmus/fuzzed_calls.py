"""FMI calls made from bytes: inputs drawn once and for all, and the program that makes the calls of them."""

from __future__ import annotations

import os
import random
import subprocess
from collections.abc import Sequence
from pathlib import Path

from support.fmus import fmu_library

INPUTS = 300


def drawn(name: str, count: int = INPUTS) -> list[bytes]:
    """The inputs of one FMU."""
    generator = random.Random(name)
    return [generator.randbytes(400) for _ in range(count)]


def calls(folder: Path, flags: Sequence[str] = ()) -> Path:
    """The fuzz target as a program that is fed inputs."""
    return fmu_library.program(folder, "calls", "gcc", flags, others=[fmu_library.FUZZ / "firmware" / "replay.c"])


def feed(program: Path, table: Path, inputs: list[bytes]) -> str:
    """Output of the program for all inputs; it ends at the first that breaks an invariant."""
    given = b"".join(len(one).to_bytes(2, "little") + one for one in inputs)
    settings = {"INKLOOP_FMU_TABLE": str(table), "INKLOOP_FUZZ_SHOWS": "1"}
    done = subprocess.run([program], input=given, env=os.environ | settings, capture_output=True, check=False)
    output = done.stderr.decode(errors="replace")
    through = len(done.stdout)
    if done.returncode:
        hexadecimal = inputs[through].hex() if through < len(inputs) else ""
        raise AssertionError(f"input {through} ends with {done.returncode}: {output[-2000:]}\n{hexadecimal}")
    return output

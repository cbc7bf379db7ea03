"""Another process that waits at a known place, such as with the lock of a run folder."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

HOLDING = """
import sys
from pathlib import Path
from inkloop.results.lock import sole_writer
with sole_writer(Path(sys.argv[1])):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def other_process(program: str, *words: str) -> Iterator[subprocess.Popen[str]]:
    """Another process that has come to the place where it holds a folder; it continues when its input ends."""
    command = [sys.executable, "-c", program, *words]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert any(line == "held\n" for line in iter(process.stdout.readline, ""))
            yield process
        finally:
            process.kill()

"""A machine that is busy with other work."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

BUSY = """
import os, sys, time
parent, until = os.getppid(), time.monotonic() + float(sys.argv[1])
while os.getppid() == parent and time.monotonic() < until:
    sum(range(100_000))
"""


@contextmanager
def busy_processes(count: int, limit_s: float = 3600.0) -> Iterator[None]:
    """Processes that compute all the time, until the end of the block, of this process, or of `limit_s` seconds."""
    processes = [subprocess.Popen([sys.executable, "-c", BUSY, str(limit_s)]) for _ in range(count)]
    try:
        yield
        assert all(one.poll() is None for one in processes), "the machine was not busy to the end"
    finally:
        for one in processes:
            one.kill()
            one.wait()

"""Folders shared by tests for a whole run: each is filled once, for any number of files and workers.

tests/conftest.py makes the folder of a run and removes it.
"""

from __future__ import annotations

import fcntl
import functools
import hashlib
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

RUN_FOLDER = "INKLOOP_TEST_FOLDER"
"""Environment variable with the folder of the run, which the workers inherit."""


@functools.cache
def run_folder() -> Path:
    """The folder that all workers of a run share; one of its own outside of pytest."""
    return Path(os.environ.get(RUN_FOLDER) or tempfile.mkdtemp(prefix="inkloop-tests-"))


def once(make: Callable[..., object], *key: object) -> Path:
    """The folder that `make(folder, *key)` fills, once per run; the key is all that its contents depend on."""
    words = "\0".join([make.__module__, make.__qualname__, *map(str, key)])
    folder = run_folder() / hashlib.sha256(words.encode()).hexdigest()[:24]
    with folder.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = folder / ".done"
        if not done.exists():
            folder.mkdir(exist_ok=True)
            make(folder, *key)
            done.touch()
    return folder

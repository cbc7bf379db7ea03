"""All tests of the nodes and their wire once more, with the address and undefined-behaviour sanitizers compiled in."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.benches.node_bench import ROOT

TESTS = [
    *(f"unit/test_node_{name}.py" for name in ("interlocks", "journal", "layer_order", "transfer")),
    *(f"unit/test_wire_{name}.py" for name in ("isotp", "slcan")),
    *("unit/test_e2e.py", "unit/test_link_transfer.py"),
    *(f"contract/test_bench_{name}.py" for name in ("process", "surface")),
]
FLAGS = "-g -fsanitize=address,undefined -fno-sanitize-recover=all"


def preloaded() -> str | None:
    """What Python has to load first: gcc's address sanitizer, and libstdc++, whose exceptions it looks after."""
    if sys.platform != "linux" or not shutil.which("gcc"):
        return None
    paths = []
    for name in ("libasan.so", "libstdc++.so.6"):
        said = subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, text=True, check=True).stdout
        paths.append(Path(said.strip()))
    return " ".join(map(str, paths)) if all(path.is_absolute() and path.exists() for path in paths) else None


@pytest.mark.long
@pytest.mark.compiled
def test_sanitizers_find_nothing_in_the_tests_of_the_nodes() -> None:
    libraries = preloaded()
    if libraries is None:
        pytest.skip("gcc with its address sanitizer for Linux is not installed")
    chosen = {"INKLOOP_SANITIZERS": FLAGS, "LD_PRELOAD": libraries, "ASAN_OPTIONS": "detect_leaks=0"}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        *(f"tests/{name}" for name in TESTS),
    ]
    done = subprocess.run(command, cwd=ROOT, env=os.environ | chosen, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr

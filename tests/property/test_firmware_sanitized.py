"""All tests of the nodes and their wire once more, with the address and undefined-behaviour sanitizers compiled in."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from support.compiled import sanitizer_libraries
from support.places import ROOT

TESTS = [
    *(
        f"unit/firmware/test_{name}.py"
        for name in ("interlocks", "journal", "storage", "layer_order", "transfer", "isotp", "slcan")
    ),
    *("unit/hardware/protocol/test_e2e.py", "unit/hardware/link/test_transfers.py"),
    *("system/test_bench_process.py", "system/test_bench_surface.py"),
]
FLAGS = "-g -fsanitize=address,undefined -fno-sanitize-recover=all"


@pytest.mark.long
@pytest.mark.compiled
def test_sanitizers_find_nothing_in_the_tests_of_the_nodes() -> None:
    libraries = sanitizer_libraries()
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

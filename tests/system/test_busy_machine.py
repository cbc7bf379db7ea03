"""The bench works on a machine that is busy with other work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support.benches import node_bench
from support.busy_machine import busy_processes

ROOT = Path(__file__).parents[2]
PROCESSES = 16
CHOSEN = (
    "test_adapter_faults.py::test_frame_that_is_not_taken_is_sent_again[ENOBUFS]",
    "test_bench_run.py::test_run_on_a_bench_is_the_run_with_fmus_to_the_bit[one ink]",
    "test_fault_table.py::test_new_master_reads_the_journal_and_repeats_nothing",
    "test_rig.py::test_killed_bus_process_leaves_nothing_enabled_and_is_reported",
)


@pytest.mark.long
def test_bench_works_beside_busy_processes() -> None:
    """A test of each way to be late: frames sent again, a whole run, a new master after another, a dead bus process.

    Once each: all exchange thousands of frames between three processes, each of which waits for the busy ones.
    """
    tests = [f"tests/system/{name}" for name in CHOSEN]
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests]
    node_bench.process()  # what the tests compile is kept for them: no compiler need share the busy machine
    node_bench.library()
    with busy_processes(PROCESSES):
        found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr

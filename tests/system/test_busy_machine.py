"""The bench works on a machine that is busy with other work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support.busy_machine import busy_processes

ROOT = Path(__file__).parents[2]
PROCESSES, ROUNDS = 16, 20
CHOSEN = (
    "test_adapter_faults.py::test_frame_that_is_not_taken_is_sent_again[ENOBUFS]",
    "test_bench_process.py::test_stock_tools_print_cure_scan_and_read_the_journal",
    "test_mapped_rig.py::test_rig_with_its_own_dbc_prints_what_is_commanded",
    "test_rig.py::test_layer_is_printed_scanned_and_fetched_as_by_the_nodes_themselves",
    "test_rig.py::test_stop_request_stays_until_it_is_taken_back_and_a_person_clears",
)
REPEAT = """
import sys, pytest
rounds, *tests = sys.argv[1:]
codes = [pytest.main(["-p", "no:cacheprovider", *tests]) for _ in range(int(rounds))]
print("codes", *map(int, codes))
"""


@pytest.mark.long
def test_bench_works_beside_busy_processes() -> None:
    """Chosen tests, in every one of 20 rounds; one process, so that only the first round waits for imports."""
    tests = [f"tests/system/{name}" for name in CHOSEN]
    with busy_processes(PROCESSES):
        command = [sys.executable, "-c", REPEAT, str(ROUNDS), *tests]
        found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.stdout.splitlines()[-1:] == ["codes" + ROUNDS * " 0"], found.stdout + found.stderr

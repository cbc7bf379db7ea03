"""Prints and checks of the bench pass on a machine that is busy with other work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from support.busy_machine import busy_processes

ROOT = Path(__file__).parents[2]
PROCESSES, ROUNDS = 16, 20
CHOSEN = (
    "test_adapter_faults.py::test_print_continues_automatically_where_no_step_is_unknown[unplugged:step=download,layer=2]",
    "test_adapter_faults.py::test_frame_that_is_not_taken_is_sent_again[ENOBUFS]",
    "test_bench_process.py::test_stock_tools_print_cure_scan_and_read_the_journal",
    "test_mapped_rig.py::test_rig_with_its_own_dbc_prints_what_is_commanded",
    "test_rig.py::test_layer_is_printed_scanned_and_fetched_as_by_the_nodes_themselves",
    "test_rig.py::test_stop_request_stays_until_it_is_taken_back_and_a_person_clears",
)


@pytest.mark.long
@pytest.mark.parametrize("turn", range(1, ROUNDS + 1))
def test_bench_works_beside_busy_processes(turn: int) -> None:
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *(f"tests/system/{name}" for name in CHOSEN)]
    with busy_processes(PROCESSES):
        found = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert found.returncode == 0, found.stdout + found.stderr
    assert f"{len(CHOSEN)} passed" in found.stdout, found.stdout

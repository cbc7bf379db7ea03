"""Faults that could injure a person: what the nodes do now is what the page of the emulator's faults shows."""

from __future__ import annotations

from tools.figures import bench_faults
from tools.figures.pages import read_json

from support.benches.refusals import HEADS, rows


def test_record_of_the_page_is_what_the_nodes_do() -> None:
    heads, *recorded = read_json(bench_faults.RECORD)["refusals"]
    assert tuple(heads) == HEADS
    assert [tuple(row) for row in recorded] == rows(), "run: python -m tools.figures bench_faults/refusals"


def test_nothing_stays_energised_in_any_row() -> None:
    assert {state.partition(",")[0] for *_, state, _ in rows()} <= {"SAFE", "FAULT", "IDLE", "VERIFIED", "PRINTED"}

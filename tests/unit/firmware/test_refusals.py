"""Faults that could injure a person: what the nodes do now is what the page of the emulator's faults shows."""

from __future__ import annotations

from support.benches.refusals import HEADS, rows
from support.page_tables import rows_of


def test_page_shows_what_the_nodes_do() -> None:
    assert rows_of("reference/bench-faults.md", HEADS) == rows()


def test_nothing_stays_energised_in_any_row() -> None:
    assert {state.partition(",")[0] for *_, state, _ in rows()} <= {"SAFE", "FAULT", "IDLE", "VERIFIED", "PRINTED"}

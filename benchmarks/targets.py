"""Targets of the controller, case by case, in one run: whole prints, then single layer problems."""

from __future__ import annotations

from rich.console import Group

from benchmarks import planned_targets, printed_targets


def measure(seeds: int) -> Group:
    """Both tables; they take some minutes."""
    return Group(printed_targets.measure(seeds), planned_targets.measure())

"""Support of the part of a scenario: the ink that holds it, or what is left out where nothing does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.geometry import overhangs
from inkloop.geometry.overhang import GAP_M
from inkloop.limits import plain_text
from inkloop.tables.job import ink_heights, is_supported
from inkloop.units import NL_PER_M3

if TYPE_CHECKING:
    from inkloop.scenario.file import Scenario

_PLACES = {"below-overhangs": "below overhangs", "around": "around the part"}


@dataclass(frozen=True)
class Supported:
    """Effect of `[support]` on a part.

    kind: that of the table; cells, volume: those of ink B [m3], of "none" those of overhangs, which are not printed.
    """

    kind: str
    cells: int
    volume: float

    @classmethod
    def of(cls, scenario: Scenario) -> Supported | None:
        """None where nothing is added to the part, and nothing of it left out."""
        table, job = scenario.tables.support, scenario.job()
        if table is None:
            return None
        heights, area, kind = ink_heights(job), job.pitch**2, table.kind
        if is_supported(scenario.tables):
            cells = int((heights[1] > GAP_M).sum())
            return cls(kind, cells, float(heights[1].sum()) * area) if cells else None
        part = scenario.solid.columns(job.nx, job.ny, job.pitch)
        found = overhangs(part)
        return cls(kind, found.cells, part.volume - float(np.sum(heights)) * area) if found else None

    def __str__(self) -> str:
        """For a person."""
        amount, cells = f"{plain_text(self.volume * NL_PER_M3, 5)} nl", f"on {self.cells:,} cells"
        if self.kind in _PLACES:
            return f"{amount} of ink B {_PLACES[self.kind]}, {cells}"
        return f"none, {amount} that hang {cells} are not printed"

    def data(self) -> dict[str, Any]:
        """For a program."""
        return {"kind": self.kind, "cells": self.cells, "nl": self.volume * NL_PER_M3}

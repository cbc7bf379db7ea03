"""`[metrology]`: parameters of the printed surface that a run writes down."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, field_validator, model_validator

from inkloop.errors import nearest
from inkloop.metrology.evaluation.definitions import (
    DEFINITIONS,
    Evaluation,
    FilterOrder,
    FOperation,
    Treatment,
    symbols,
)
from inkloop.tables.shapes import Length, Table
from inkloop.units import M_PER_UM


class MetrologyTable(Table):
    """`[metrology]`: parameters of the printed surface over the part, in `summary.txt` and `result.nc`."""

    parameters: list[str] = Field(
        default=["Sa", "Sq", "Sz"],
        min_length=1,
        description="symbols of the page on metrology, as `inkloop metrology --json` has them, without units",
    )
    f_operation: FOperation = Field(
        default="plane",
        description='taken off the heights: "none": their mean only, "plane", "form": a polynomial of second order, '
        '"target"',
    )
    s_filter_um: Length | None = Field(default=None, description="cutoff below which waves are removed")
    l_filter_um: Length | None = Field(default=None, description="cutoff above which waves are removed")
    filter_order: FilterOrder = Field(default=1, description="regression order of the filters, 0 or 1")
    profile: Literal["x", "y"] | None = Field(
        default=None, description="axis of the rows that P- and R-parameters are evaluated on"
    )
    every_layer: bool = Field(default=False, description="also after every layer, as curves in `result.nc`")

    @field_validator("parameters")
    @classmethod
    def _are_known(cls, found: list[str]) -> list[str]:
        wrong = [symbol for symbol in found if symbol not in DEFINITIONS]
        if wrong:
            raise ValueError(
                "; ".join(f"{symbol!r} is no parameter: {nearest(symbol, DEFINITIONS)}" for symbol in wrong)
            )
        return found

    @model_validator(mode="after")
    def _fits_together(self) -> MetrologyTable:
        profiles = [symbol for symbol in self.parameters if symbol in symbols("profile")]
        if profiles and self.profile is None:
            raise ValueError(f'{", ".join(profiles)} need profile = "x" or "y" as well')
        letter = "P" if self.l_filter_um is None else "R"
        if others := [symbol for symbol in profiles if not symbol.startswith(letter)]:
            needs = "needs l_filter_um, the section length" if letter == "P" else "is of profiles without l_filter_um"
            raise ValueError(f"{', '.join(others)} {needs}")
        if self.s_filter_um is not None and self.l_filter_um is not None and self.s_filter_um >= self.l_filter_um:
            raise ValueError("expected s_filter_um below l_filter_um")
        return self

    @property
    def evaluation(self) -> Evaluation:
        """The evaluation in SI."""
        short, long = (None if um is None else um * M_PER_UM for um in (self.s_filter_um, self.l_filter_um))
        treatment = Treatment(self.f_operation, short, long, self.filter_order)
        return Evaluation(tuple(self.parameters), treatment, self.profile, self.every_layer)

"""Treatment of heights before their evaluation, and the choice of parameters."""

from __future__ import annotations

from dataclasses import dataclass

from inkloop.metrology.evaluation.definitions import F_OPERATIONS, Axis, FilterOrder, FOperation, Group
from inkloop.units import UM_PER_M


@dataclass(frozen=True)
class Treatment:
    """Filters and F-operation; cutoffs (nesting indices) [m], None: no filter."""

    f_operation: FOperation = "plane"
    s_filter: float | None = None
    l_filter: float | None = None
    filter_order: FilterOrder = 1

    def __str__(self) -> str:
        return f"taken off: {F_OPERATIONS[self.f_operation]}; {self._filters(self.s_filter, self.l_filter)}"

    def of(self, group: Group) -> str:
        """Treatment before the parameters of a group: form keeps its form, a volume its heights."""
        if group == "form":
            return f"nothing taken off; {self._filters(self.s_filter, None)}"
        return "nothing taken off; no filter" if group == "volume" else str(self)

    def _filters(self, s_filter: float | None, l_filter: float | None) -> str:
        names = {"S-filter": s_filter, "L-filter": l_filter}
        used = [f"{name} {cutoff * UM_PER_M:g} µm" for name, cutoff in names.items() if cutoff is not None]
        return f"{', '.join(used)} (Gaussian, regression order {self.filter_order})" if used else "no filter"


@dataclass(frozen=True)
class Evaluation:
    """The parameters that are wanted, by symbol; axis: of the profiles, which need one; each layer, or the last one."""

    symbols: tuple[str, ...]
    treatment: Treatment = Treatment()
    axis: Axis | None = None
    every_layer: bool = False

"""Preparation of a surface: the cells that count, and their heights after the filters and the F-operation.

The order is that of ISO 25178-3: S-filter, F-operation, L-filter. Heights are counted from their mean.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import isclose
from typing import TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.evaluation.definitions import Axis, FOperation, Treatment
from inkloop.metrology.evaluation.filters import cutoff_error, gaussian
from inkloop.metrology.height_map import HeightMap

CELLS_MIN = 50
_FLAT = 1e-12
"""Share of the range of heights before the F-operation, below which the remaining heights are rounding."""


@dataclass(frozen=True)
class Refusal:
    """The reason why a parameter has no value, a clause without a full stop."""

    reason: str


Found: TypeAlias = Mapping[str, float | Refusal]
"""Symbol -> value in SI, or the reason why there is none."""


def refused(symbols: Iterable[str], reason: str) -> Found:
    """All of the parameters without a value."""
    return dict.fromkeys(symbols, Refusal(reason))


@dataclass(frozen=True, eq=False)
class Surface:
    """Heights z (m, n) [m], 0 where they do not count; used: cells that count; mask: cells to evaluate."""

    z: FloatMap
    used: BoolMap
    mask: BoolMap
    dx: float
    dy: float

    @property
    def heights(self) -> FloatMap:
        """(N,) heights of the cells that count."""
        return np.asarray(self.z[self.used], np.float64)


def asked_cells(map_: HeightMap, mask: BoolMap | None) -> BoolMap:
    """The mask, or all cells. Raises HeightMapError for one of another shape."""
    asked = np.ones(map_.shape, np.bool_) if mask is None else np.asarray(mask, np.bool_)
    if asked.shape != map_.shape:
        raise HeightMapError(f"{map_.source}: has {map_.shape} cells, its mask {asked.shape}; give a mask of its shape")
    return asked


def cells_refusal(used: BoolMap, mask: BoolMap, missing_max: float) -> Refusal | None:
    """The reason why too few cells count: fewer than CELLS_MIN, or a larger share of the mask without a height."""
    count, asked = int(used.sum()), int(mask.sum())
    if count < CELLS_MIN:
        return Refusal(f"{count} cells have a height; needs {CELLS_MIN}: take a larger mask or map")
    if asked - count > missing_max * asked:
        return Refusal(
            f"{asked - count} of {asked} cells ({1.0 - count / asked:.0%}) have no height; at most {missing_max:.0%} "
            "may lack one: take a smaller mask, measure again, or allow more with `inkloop metrology --missing`"
        )
    return None


def evaluated(
    map_: HeightMap,
    mask: BoolMap | None = None,
    treatment: Treatment | None = None,
    *,
    target: FloatMap | None = None,
    axis: Axis | None = None,
) -> Surface | Refusal:
    """The surface after its treatment, or the reason why there is none.

    target: (m, n) [m], subtracted by the F-operation "target"; axis: filters act along this one only, for profiles.
    Raises HeightMapError for a mask of another shape.
    """
    how, asked = treatment or Treatment(), asked_cells(map_, mask)
    used = asked & map_.valid
    if reason := cells_refusal(used, asked, how.missing_max):
        return reason
    cutoffs = [cutoff for cutoff in (how.s_filter, how.l_filter) if cutoff is not None]
    for cutoff in cutoffs:
        if wrong := cutoff_error(used, (map_.dx, map_.dy), cutoff, axis):
            return Refusal(wrong)
    if len(cutoffs) == 2 and cutoffs[0] >= cutoffs[1]:
        return Refusal("the S-filter is as wide as the L-filter or wider, and leaves nothing between them")
    if how.f_operation == "target" and target is None:
        return Refusal("a map knows no target; evaluate a run, or take off a plane or a form")

    def smooth(z: FloatMap, cutoff: float) -> FloatMap:
        return gaussian(z, used, (map_.dx, map_.dy), cutoff, order=how.filter_order, axis=axis)

    before = float(np.ptp(map_.z[used]))
    z = np.where(used, map_.z - map_.z[used].mean(), 0.0)
    if how.s_filter is not None:
        z = smooth(z, how.s_filter)
    without = _without_form(z, used, how.f_operation, target, axis)
    if isinstance(without, Refusal):
        return without
    z = without if how.l_filter is None else without - smooth(without, how.l_filter)
    z = np.where(used, z - z[used].mean(), 0.0)
    if isclose(before, before + float(np.abs(z).max()), rel_tol=_FLAT):
        z = np.zeros_like(z)
    return Surface(z, used, asked, map_.dx, map_.dy)


def s_filtered(map_: HeightMap, treatment: Treatment) -> HeightMap | Refusal:
    """The map after the S-filter alone, over all of its cells with heights."""
    if treatment.s_filter is None:
        return map_
    steps = map_.dx, map_.dy
    if wrong := cutoff_error(map_.valid, steps, treatment.s_filter):
        return Refusal(wrong)
    z = gaussian(np.where(map_.valid, map_.z, 0.0), map_.valid, steps, treatment.s_filter, order=treatment.filter_order)
    return HeightMap(np.where(map_.valid, z, np.nan), *steps, source=map_.source)


def _without_form(
    z: FloatMap, used: BoolMap, operation: FOperation, target: FloatMap | None, axis: Axis | None
) -> FloatMap | Refusal:
    """Heights after the F-operation: least squares of vertical distances over the used cells."""
    if operation == "none":
        return z
    if operation == "target" and target is not None:
        return z - np.where(used, target, 0.0)
    places = np.indices(z.shape) / max(z.shape)
    sides = [k for k in (0, 1) if axis is None or z.shape[k] > 1]  # of one profile its line is taken off
    linear = [places[k] - places[k][used].mean() for k in sides]
    squares = [a * b for a, b in combinations_with_replacement(linear, 2)] if operation == "form" else []
    terms = [np.ones_like(z), *linear, *squares]
    columns = np.stack([term[used] for term in terms], axis=-1)
    factors, _, rank, _ = np.linalg.lstsq(columns, z[used], rcond=None)
    if rank < columns.shape[1]:
        shape = {"plane": "lie on one line and define no plane", "form": "lie on a conic and define no second order"}
        return Refusal(f"its cells {shape[operation]}; take the mean off only")
    return np.asarray(z - np.tensordot(factors, np.stack(terms), axes=1), np.float64)

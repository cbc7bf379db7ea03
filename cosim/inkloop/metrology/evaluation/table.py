"""The table of parameters of a surface: each with its value, or with the reason why it has none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan, pi

import numpy as np

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.evaluation.areal import (
    height_parameters,
    hybrid_parameters,
    material_ratio_parameters,
    spatial_parameters,
)
from inkloop.metrology.evaluation.definitions import DEFINITIONS, Axis, Evaluation, Group, Treatment, symbols
from inkloop.metrology.evaluation.profile import PRIMARY, ROUGHNESS, Profiles, profile_parameters
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found, Refusal, evaluated, refused
from inkloop.metrology.height_map import HeightMap
from inkloop.units import NL_PER_M3, PL_PER_M3, UM_PER_M

SHOWN: Mapping[str, float] = {"um": UM_PER_M, "nl": NL_PER_M3, "pl": PL_PER_M3, "deg": 180.0 / pi, "1": 1.0}
"""Unit in keys -> factor from SI."""
_PRINTED = {"um": "µm", "deg": "°", "1": ""}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a surface: `value` in SI, or NaN with the `reason` why it has none.

    symbol: as of ISO, or a key; name: in plain words; unit: of the value, "m", "m3", "rad" or "1".
    """

    symbol: str
    name: str
    value: float
    unit: str
    reason: str = ""

    @property
    def shown_unit(self) -> str:
        """The unit in tables, as keys have it: "um", "nl", "pl", "deg" or "1"."""
        return DEFINITIONS[self.symbol].shown

    @property
    def printed_unit(self) -> str:
        """The same for a person, "" for a ratio or a count."""
        return _PRINTED.get(self.shown_unit, self.shown_unit)

    @property
    def shown(self) -> float:
        """The value in the unit of tables."""
        return self.value * SHOWN[self.shown_unit]

    @property
    def key(self) -> str:
        """The symbol with the unit of tables: "Sa_um", "Ssk"."""
        return self.symbol if self.shown_unit == "1" else f"{self.symbol}_{self.shown_unit}"


def parameters(
    heights: FloatMap,
    mask: BoolMap | None,
    pitch: float,
    *,
    groups: Iterable[Group] = ("areal",),
    treatment: Treatment | None = None,
    target: FloatMap | None = None,
    start: FloatMap | None = None,
    droplets: int | None = None,
) -> tuple[Parameter, ...]:
    """The parameters of a surface in the order of DEFINITIONS, by default the areal ones of ISO 25178-2.

    heights: (m, n) [m], NaN where there is none; mask: (m, n), cells of the part, None: all; pitch [m]; groups:
    "areal", "form", "volume"; treatment: filters and F-operation, by default the plane is subtracted; target, start:
    (m, n) [m], nominal heights of the part, and heights before the print; droplets: number of droplets. Raises
    HeightMapError for maps of different shapes.
    """
    subject = Subject(HeightMap(heights, pitch, pitch), mask, target, start, droplets)
    return rows({symbol: value for group in groups for symbol, value in found(subject, group, treatment).items()})


def found(subject: Subject, group: Group, treatment: Treatment | None = None) -> Found:
    """The parameters of a group other than "profile"."""
    if group == "form":
        return subject.form_parameters(treatment)
    if group == "volume":
        below = subject.substrate_heights()
        return _volume_parameters(subject.map_, subject.cells, below, subject.target, subject.droplets)
    surface = evaluated(subject.map_, subject.mask, treatment, target=subject.target)
    if isinstance(surface, Refusal):
        return refused(symbols(group), surface.reason)
    functions = (height_parameters, hybrid_parameters, material_ratio_parameters, spatial_parameters)
    return {symbol: value for function in functions for symbol, value in function(surface).items()}


def evaluate(subject: Subject, wanted: Evaluation) -> tuple[Parameter, ...]:
    """The wanted parameters; only their groups are computed."""
    values: dict[str, float | Refusal] = {}
    for group in {DEFINITIONS[symbol].group for symbol in wanted.symbols}:
        if group != "profile":
            values |= found(subject, group, wanted.treatment)
        elif wanted.axis is not None:
            values |= found_on_profiles(subject, wanted.axis, wanted.treatment)[0]
    return rows(values, wanted.symbols)


def found_on_profiles(
    subject: Subject, axis: Axis, treatment: Treatment | None = None
) -> tuple[Found, Profiles | None]:
    """The P-parameters of rows along an axis, or with an L-filter the R-parameters, and their profiles."""
    how = treatment or Treatment()
    surface = evaluated(subject.map_, subject.mask, how, target=subject.target, axis=axis)
    if isinstance(surface, Refusal):
        return refused(PRIMARY if how.l_filter is None else ROUGHNESS, surface.reason), None
    return profile_parameters(surface, axis, how.l_filter)


def rows(found: Found, chosen: Iterable[str] | None = None) -> tuple[Parameter, ...]:
    """The parameters computed, or the chosen ones of them, in the order of DEFINITIONS."""
    wanted = set(found if chosen is None else chosen)
    return tuple(_row(symbol, found[symbol]) for symbol in DEFINITIONS if symbol in wanted & found.keys())


def _row(symbol: str, value: float | Refusal) -> Parameter:
    definition = DEFINITIONS[symbol]
    if isinstance(value, Refusal):
        return Parameter(symbol, definition.name, nan, definition.unit, value.reason)
    return Parameter(symbol, definition.name, value, definition.unit)


def _volume_parameters(
    map_: HeightMap, mask: BoolMap, substrate: FloatMap | Refusal, target: FloatMap | None, droplets: int | None
) -> Found:
    """volume_printed, volume_target, volume_error, droplet_volume [m3], droplets [1].

    printed = sum over the part of (height - substrate) dx dy
    target  = sum over the part of (target - substrate) dx dy      error = target - printed (positive: too little)
    droplet = sum over the whole map of (height - substrate) dx dy / droplets

    A cell without a height would make a volume too small, and no height is invented: then there is no volume.

    substrate: (m, n) height below the part [m].
    """
    cell = map_.dx * map_.dy

    def volume(top: FloatMap | None, cells: BoolMap) -> float | Refusal:
        if isinstance(substrate, Refusal):
            return substrate
        if top is None:
            return Refusal("a map knows no target; evaluate a run")
        thickness = (top - substrate)[cells]
        if lacking := int(np.isnan(thickness).sum()):
            return Refusal(f"{lacking} cells have no height: what stands on them is unknown")
        return float(thickness.sum()) * cell

    printed, wanted = volume(map_.z, mask), volume(target, mask)
    whole = volume(map_.z, np.ones_like(mask))
    counted = Refusal("a map knows no droplets; evaluate a run") if droplets is None else float(droplets)
    error = wanted - printed if isinstance(wanted, float) and isinstance(printed, float) else _reason(wanted, printed)
    each: float | Refusal = Refusal("no droplet landed")
    if isinstance(whole, Refusal) or isinstance(counted, Refusal):
        each = _reason(whole, counted)
    elif counted > 0.0:
        each = whole / counted
    return {
        "volume_printed": printed,
        "volume_target": wanted,
        "volume_error": error,
        "droplets": counted,
        "droplet_volume": each,
    }


def _reason(*values: float | Refusal) -> Refusal:
    return next(value for value in values if isinstance(value, Refusal))

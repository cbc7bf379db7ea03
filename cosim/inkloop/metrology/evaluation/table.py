"""The table of parameters of a surface: each with its value, or with the reason why it has none."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from math import nan, pi

from inkloop.component import BoolMap, FloatMap
from inkloop.metrology.evaluation.areal import height_parameters, hybrid_parameters
from inkloop.metrology.evaluation.definitions import DEFINITIONS, Axis, Group, symbols
from inkloop.metrology.evaluation.material_ratio import material_ratio_parameters
from inkloop.metrology.evaluation.profile import PRIMARY, ROUGHNESS, Profiles, profile_parameters
from inkloop.metrology.evaluation.spatial import spatial_parameters
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found, Refusal, evaluated, refused
from inkloop.metrology.evaluation.treatment import Evaluation, Treatment
from inkloop.metrology.evaluation.volume import volume_parameters
from inkloop.metrology.height_map import HeightMap
from inkloop.units import NL_PER_M3, PL_PER_M3, UM_PER_M

SHOWN: Mapping[str, float] = {"um": UM_PER_M, "nl": NL_PER_M3, "pl": PL_PER_M3, "deg": 180.0 / pi, "1": 1.0}
"""Unit in keys -> factor from SI."""
PRINTED_UNITS: Mapping[str, str] = {"um": "µm", "deg": "°"}
"""Unit in keys -> unit for a person, where it differs."""


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
        return volume_parameters(subject.map_, subject.cells, below, subject.target, subject.droplets)
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

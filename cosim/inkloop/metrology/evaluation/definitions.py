"""The parameters by symbol, their choice, and the treatment before them; importable without the code that computes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from inkloop.units import UM_PER_M

FOperation: TypeAlias = Literal["none", "plane", "form", "target"]
F_OPERATIONS: Mapping[FOperation, str] = {
    "none": "mean height",
    "plane": "least-squares plane",
    "form": "least-squares polynomial of second order",
    "target": "target height, then the mean",
}
"""F-operations: the form that is subtracted from the heights."""
FilterOrder: TypeAlias = Literal[0, 1]
Axis: TypeAlias = Literal["x", "y"]
MISSING_MAX = 0.2  # assumed
Need: TypeAlias = Literal["", "part", "target", "droplets"]
Group: TypeAlias = Literal["areal", "profile", "form", "volume"]


@dataclass(frozen=True)
class Definition:
    """A parameter: its name in plain words, SI unit, the group it is computed with, and the unit it is shown in.

    Ratios have the unit "1", counts and ratios are shown as they are. needs: what must be known beside the heights.
    """

    name: str
    unit: str = "m"
    group: Group = "areal"
    shown: str = "um"
    needs: Need = ""


def _ratio(name: str) -> Definition:
    return Definition(name, "1", shown="1")


def _form(name: str, unit: str = "m", shown: str = "um") -> dict[str, Definition]:
    """A quantity by least squares and by minimum zone, with the method in its symbol and name."""
    symbol = name.split(",")[0].replace(" ", "_")
    methods = {"ls": "least squares", "mz": "minimum zone"}
    needs: Need = "" if symbol == "flatness" else "part"
    return {
        f"{symbol}_{key}": Definition(f"{name}, {method}", unit, "form", shown, needs)
        for key, method in methods.items()
    }


def _profile(letter: str, kind: str, z: str) -> dict[str, Definition]:
    names = {
        "a": "arithmetic mean height",
        "q": "root mean square height",
        "p": "mean peak height" if z else "peak height",
        "v": "mean pit depth" if z else "pit depth",
        **({"z": z} if z else {}),
        "t": "total height",
        "sk": "skewness",
        "ku": "kurtosis",
        "sm": "mean element spacing",
    }
    lengths = {f"{letter}{key}": Definition(f"{name} of the {kind}", group="profile") for key, name in names.items()}
    ratios = {letter + key: replace(lengths[letter + key], unit="1", shown="1") for key in ("sk", "ku")}
    return lengths | ratios


DEFINITIONS: Mapping[str, Definition] = {
    "Sa": Definition("arithmetical mean height"),
    "Sq": Definition("root mean square height"),
    "Sz": Definition("maximum height"),
    "Sp": Definition("maximum peak height"),
    "Sv": Definition("maximum pit depth"),
    "Ssk": _ratio("skewness"),
    "Sku": _ratio("kurtosis"),
    "Sdq": _ratio("root mean square gradient"),
    "Sdr": _ratio("developed interfacial area ratio"),
    "Sk": Definition("core height"),
    "Spk": Definition("reduced peak height"),
    "Svk": Definition("reduced dale height"),
    "Smr1": _ratio("material ratio of the hills"),
    "Smr2": _ratio("material ratio of the dales"),
    "Vmp": Definition("peak material volume per area"),
    "Vmc": Definition("core material volume per area"),
    "Vvc": Definition("core void volume per area"),
    "Vvv": Definition("pit void volume per area"),
    "Sal": Definition("autocorrelation length"),
    "Str": _ratio("texture aspect ratio"),
    "Std": Definition("texture direction, from x towards y", "rad", shown="deg"),
    **_profile("P", "primary profile", ""),
    **_profile("R", "roughness profile", "mean maximum height"),
    **_form("flatness"),
    **_form("parallelism, to the substrate"),
    **_form("step height, above the substrate"),
    **_form("wall angle, from the substrate", "rad", "deg"),
    **_form("radius, of the outline at half height"),
    **_form("roundness, of the outline at half height"),
    "volume_printed": Definition("volume printed on the part", "m3", "volume", "nl", "part"),
    "volume_target": Definition("volume that the part shall have", "m3", "volume", "nl", "target"),
    "volume_error": Definition("target minus printed volume (positive: too little)", "m3", "volume", "nl", "target"),
    "droplets": Definition("droplets that landed", "1", "volume", "1", "droplets"),
    "droplet_volume": Definition("printed volume of the whole grid per droplet", "m3", "volume", "pl", "droplets"),
}
"""Symbol -> definition, in the order of every table."""


def symbols(*groups: Group) -> tuple[str, ...]:
    """The parameters of these groups, in order."""
    return tuple(symbol for symbol, definition in DEFINITIONS.items() if definition.group in groups)


@dataclass(frozen=True)
class Treatment:
    """Filters and F-operation; cutoffs (nesting indices) [m], None: no filter.

    missing_max: share of the mask that may lack heights; above it parameters have no value.
    """

    f_operation: FOperation = "plane"
    s_filter: float | None = None
    l_filter: float | None = None
    filter_order: FilterOrder = 1
    missing_max: float = MISSING_MAX

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

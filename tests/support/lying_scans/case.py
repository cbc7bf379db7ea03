"""One kind of print on the rig, and what it must reach."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import inf, nan

from support.lying_scans.plant import LU, Droplet, Plant
from support.lying_scans.profiler import Profiler


@dataclass(frozen=True)
class Must:
    """Required results of the prints of a case; heights against the target [um], NaN: no requirement.

    mae: mean over seeds; highest, lowest: of the worst seed; stop_by: last layer at which the print may stop instead of
    ending too high (inf: at any, but it must not be done); untrusted_by: last layer at which it may become untrusted;
    trusted: it must never be untrusted; or_stops: a print that stops need not reach mae; own: figures by analogy, not
    of the design.
    """

    mae: float = nan
    highest: float = nan
    lowest: float = nan
    stop_by: float = nan
    untrusted_by: float = nan
    trusted: bool = False
    or_stops: bool = False
    own: bool = False


STOPS_AT_ALL = inf


@dataclass(frozen=True)
class Case:
    """A print; `ink` is what the controller is told, `options` are those of the product's controller."""

    name: str
    must: Must
    plant: Plant = field(default_factory=Plant)
    profiler: Profiler = field(default_factory=Profiler)
    part: str = "ellipse"
    shape: tuple[int, int] = (25, 25)
    ink: Droplet = field(default_factory=lambda: LU)
    drop_levels: int = 1
    options: Mapping[str, object] = field(default_factory=dict)

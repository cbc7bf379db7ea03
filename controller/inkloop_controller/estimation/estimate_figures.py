"""What is reported of an estimate, and the reasons why it is not trusted."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import Any

from inkloop.component import Ink
from inkloop_controller.core.bindings import ink_pair
from inkloop_controller.core.structs import InkStruct


class UntrustedReason(IntFlag):
    """Why the status is untrusted; from NO_GROWTH on the print is stopped."""

    UNSEEN = 1  # cells of the part have lived on prediction for too many layers
    BLIND = 2  # most of the part was not measured in the last scans
    GROUND = 4  # the first scan shows ground that is called flat far from height 0
    RESIDUALS = 8  # scans differ from predictions by more than droplets and sensor explain
    INK = 16  # cells are capped: by the droplets given to them they are high enough
    HIGH = 32  # cells stand higher than they are to
    NO_GROWTH = 64  # nothing grew where droplets were jetted
    SAME_SCAN = 128  # the sensor shows an earlier scan again
    LATE = 256  # scans show the surface of an earlier layer
    TURNED = 512  # scans are mirrored or turned against the patterns
    VOLUME = 1024  # droplets bring more or less than is believed of any ink


NO_REASON = UntrustedReason(0)
_GROUND = "tuple[float, float, float]"
TRANSFORMS = (
    "", "", "mirrored in x", "mirrored in y", "turned by 180 degrees", "transposed", "turned by 90 degrees",
    "turned by 270 degrees", "transposed and turned by 180 degrees",
)  # fmt: skip
"""What brings a scan to the printer, by the number that an estimate reports."""


@dataclass(frozen=True)
class EstimateFigures:
    """What is reported of an estimate (controller/core/observer/surface_estimate.h).

    volume: of the inks as a share of the nominal ones, mean over the inks; droplet_std: of a droplet's volume, as a
    share of it, 0 before any layer; noise_std: of a reading [m]; ground: of the first scan on ground called flat:
    height of its middle, its rise over the grid along x and y [m]; surprise: what scans differ from predictions by, in
    standard deviations; blind_share: of the part that the last scan did not measure; excess: the most that a cell is
    higher by its droplets than by its scan [m], at number excess_cell; rise: the most that a cell stands above its
    target and what its droplets explain [m], at rise_cell; shift_x, shift_y: of the last scan in the middle of the
    grid [cells]: its reading of a cell is of the plant so far beyond it; shift_std: of their errors, the larger one;
    spot_radius: standard deviation of the Gaussian spot [cells], 0 while it cannot be distinguished from a point;
    spot_std: of its error; rotation [rad] and magnification [1] of the scans; stop: the reason that stopped the print,
    in layer stop_layer; transform: number in TRANSFORMS; stop_figure: how many times better a scan fits than as read,
    or a volume; is_displaced: scans are read as displaced ones; is_foreign: droplets spill onto their neighbours in
    another way than the model's; scans: so far.
    """

    volume: float = 1.0
    droplet_std: float = 0.0
    noise_std: float = 0.0
    ground: tuple[float, float, float] = (0.0, 0.0, 0.0)
    surprise: float = 1.0
    blind_share: float = 0.0
    excess: float = 0.0
    rise: float = 0.0
    shift_x: float = 0.0
    shift_y: float = 0.0
    shift_std: float = 0.0
    spot_radius: float = 0.0
    spot_std: float = 0.0
    rotation: float = 0.0
    magnification: float = 0.0
    stop_figure: float = 0.0
    reasons: UntrustedReason = NO_REASON
    stop: UntrustedReason = NO_REASON
    stop_layer: int = 0
    transform: int = 0
    unseen_cells: int = 0
    dead_cells: int = 0
    capped_cells: int = 0
    excess_cell: int = 0
    rise_cell: int = 0
    is_displaced: bool = False
    is_foreign: bool = False
    scans: int = 0

    @classmethod
    def of_struct(cls, struct: FiguresStruct) -> EstimateFigures:
        """The figures from C."""
        return cls(**{field.name: _OF_C[str(field.type)](getattr(struct, field.name)) for field in fields(cls)})

    def struct(self, inks: Sequence[Ink]) -> FiguresStruct:
        """The figures for C, with inks."""
        return FiguresStruct(ink_pair(inks), *(getattr(self, field.name) for field in fields(self)))


_C_TYPES: Mapping[str, Any] = {"float": ctypes.c_double, _GROUND: 3 * ctypes.c_double}
_OF_C: Mapping[str, Callable[[Any], Any]] = {
    "float": float, "int": int, "bool": bool, "UntrustedReason": UntrustedReason, _GROUND: tuple,
}  # fmt: skip
"""By the type of a field: its type in C, 64 bits of an integer if not given, and how it comes from there."""


class FiguresStruct(ctypes.Structure):
    """`EstimateFigures` of surface_estimate.h: the inks, and the figures in the same order."""

    _fields_ = (
        ("ink", InkStruct * 2),
        *((each.name, _C_TYPES.get(str(each.type), ctypes.c_int64)) for each in fields(EstimateFigures)),
    )

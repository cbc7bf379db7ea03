"""Reported figures of an estimate, and the reasons why it is not trusted."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from ctypes import c_double, c_int64
from dataclasses import dataclass, fields
from enum import IntFlag
from typing import Any

from inkloop_controller.core.library import InkStruct, structure


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
TRANSFORMS = (
    "", "", "mirrored in x", "mirrored in y", "turned by 180 degrees", "transposed", "turned by 90 degrees",
    "turned by 270 degrees", "transposed and turned by 180 degrees",
)  # fmt: skip
"""Transforms of a scan to the printer, by the number that an estimate reports."""


@dataclass(frozen=True)
class EstimateFigures:
    """Reported figures of an estimate; controller/core/observer/surface_estimate.h says what each figure is.

    Heights are in metres, shift and spot in cells; transform is a number in TRANSFORMS.
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
    def of_struct(cls, struct: Any) -> EstimateFigures:
        """The figures from C."""
        return cls(**{field.name: _OF_C[str(field.type)](getattr(struct, field.name)) for field in fields(cls)})


_GROUND = "tuple[float, float, float]"
_C_TYPES: Mapping[str, Any] = {"float": c_double, _GROUND: 3 * c_double}
_OF_C: Mapping[str, Callable[[Any], Any]] = {
    "float": float, "int": int, "bool": bool, "UntrustedReason": UntrustedReason, _GROUND: tuple,
}  # fmt: skip
"""By the type of a field: its type in C, 64 bits of an integer if not given, and how it comes from there."""

FiguresStruct = structure(
    "EstimateFigures",
    (InkStruct * 2, "ink"),
    *((_C_TYPES.get(str(each.type), c_int64), each.name) for each in fields(EstimateFigures)),
)

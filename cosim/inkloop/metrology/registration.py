"""Placement of a height map on the grid of cells: mirror, scale, turn, shift; from numbers or fiducials."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.errors import HeightMapError
from inkloop.metrology.height_map import Mirror
from inkloop.units import UM_PER_M

__all__ = ["Registration"]

Points: TypeAlias = Sequence[Sequence[float]] | NDArray[np.float64]
FIDUCIALS_MIN = 2
MIRROR_SUSPECTED = 0.2  # share of the residual that the mirrored map must stay below (assumed)


@dataclass(frozen=True)
class Registration:
    """Takes a point of the map to the grid: grid = offset + scale * turn(mirror(point)).

    offset_x, offset_y: place of the map's origin on the grid [m], whose origin is the centre of cell (0, 0); rotation:
    of the map on the grid, counterclockwise from x to y [rad]; mirror: the map's coordinate that counts the other way
    ("y" for pictures, whose rows go down).
    """

    offset_x: float = 0.0
    offset_y: float = 0.0
    rotation: float = 0.0
    scale: float = 1.0
    mirror: Mirror = "none"

    @property
    def matrix(self) -> NDArray[np.float64]:
        """(2, 2): matrix of a point before the shift."""
        cos, sin = self.scale * math.cos(self.rotation), self.scale * math.sin(self.rotation)
        return np.array([[cos, -sin], [sin, cos]]) * _signs(self.mirror)

    def to_grid(self, x: FloatMap, y: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Points of the map on the grid [m]; x and y broadcast."""
        (a, b), (c, d) = self.matrix
        return self.offset_x + a * x + b * y, self.offset_y + c * x + d * y

    def to_map(self, x: FloatMap, y: FloatMap) -> tuple[FloatMap, FloatMap]:
        """Points of the grid on the map [m]; x and y broadcast."""
        (a, b), (c, d) = np.linalg.inv(self.matrix)
        u, v = x - self.offset_x, y - self.offset_y
        return a * u + b * v, c * u + d * v


@dataclass(frozen=True)
class FiducialFit:
    """A registration with its residual: root mean square distance of the fiducials from their nominal places [m]."""

    registration: Registration
    residual: float


def from_fiducials(
    on_map: Points, on_grid: Points, *, mirror: Mirror = "none", with_scale: bool = False, residual_max: float
) -> FiducialFit:
    """The rigid registration that brings two or more points of the map next to those of the grid (least squares).

    on_map, on_grid: (k, 2) [m], in one order; with_scale: fit the scale too, for profilers whose magnification is not
    trusted; residual_max: a worse fit is refused [m]. Raises HeightMapError. Umeyama 1991, eq. 40-42, in the plane.
    """
    source, target = np.array(on_map, np.float64), np.array(on_grid, np.float64)
    if source.shape != target.shape or source.ndim != 2 or source.shape[1] != 2 or len(source) < FIDUCIALS_MIN:
        raise HeightMapError(
            f"fiducials: {source.shape} on the map, {target.shape} on the grid; expected the same two or more points "
            "[x, y] on both"
        )
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise HeightMapError("fiducials: a coordinate is not finite; expected lengths")
    for points, place in ((source, "map"), (target, "grid")):
        if np.ptp(points, axis=0).max() == 0.0:
            raise HeightMapError(f"fiducials: all lie on one point of the {place}; expected at least two places")
    fit = _rigid(source, target, mirror, with_scale)
    if fit.residual <= residual_max:
        return fit
    other: Mirror = "y" if mirror == "none" else "none"
    mirrored = _rigid(source, target, other, with_scale)
    hint = "check that they are given in the same order and in the same unit"
    if mirrored.residual < MIRROR_SUSPECTED * fit.residual:
        hint = f"with mirror = {other!r} it is {mirrored.residual * UM_PER_M:.3g} µm: the map is mirrored"
    raise HeightMapError(
        f"fiducials: the best fit leaves {fit.residual * UM_PER_M:.3g} µm rms, {residual_max * UM_PER_M:.3g} µm are "
        f"allowed; {hint}"
    )


def _rigid(source: FloatMap, target: FloatMap, mirror: Mirror, with_scale: bool) -> FiducialFit:
    """Least squares, with points as complex numbers: target = offset + factor * source, |factor| = 1 or free."""
    u, v = (source * _signs(mirror)) @ [1, 1j], target @ [1, 1j]
    mean_u, mean_v = u.mean(), v.mean()
    product = np.vdot(u - mean_u, v - mean_v)
    factor = product / np.vdot(u - mean_u, u - mean_u).real if with_scale else product / abs(product)
    offset = mean_v - factor * mean_u
    residual = float(np.sqrt(np.mean(np.abs(offset + factor * u - v) ** 2)))
    rotation, scale = float(np.angle(factor)), float(abs(factor)) if with_scale else 1.0
    return FiducialFit(Registration(float(offset.real), float(offset.imag), rotation, scale, mirror), residual)


def _signs(mirror: Mirror) -> NDArray[np.float64]:
    return np.array([-1.0 if mirror == "x" else 1.0, -1.0 if mirror == "y" else 1.0])

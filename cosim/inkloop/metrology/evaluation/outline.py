"""The outline of a part in its height map: radius and roundness (ISO 12181) and the angle of the wall, by two methods.

The outline is the contour at half of the step height above the plane of the substrate, interpolated between cells. Its
circle by least squares has the smallest sum of squared radial distances along the outline, the one by minimum zone the
smallest difference of the radii of two concentric circles that enclose all points.

    radius      of the circle; by minimum zone the mean of the two radii
    roundness   largest minus smallest distance of the outline to the centre
    wall angle  atan2(1, -d): d is the slope of s(h) by least squares, or with the smallest largest distance, where
                s(h) = (area inside the contour at height h - area inside the outline) / length of the outline,
                from 20 % to 80 % of the step height; 90 deg is upright
"""

from __future__ import annotations

from math import atan2, degrees

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.errors import missing
from inkloop.metrology.evaluation.form import Step, minimax
from inkloop.metrology.evaluation.surface import Found, Refusal, refused
from inkloop.metrology.height_map import HeightMap
from inkloop.units import UM_PER_M

CIRCLES = ("radius_ls", "radius_mz", "roundness_ls", "roundness_mz")
WALLS = ("wall_angle_ls", "wall_angle_mz")
ROUND = 0.2
"""Roundness as a share of the radius beyond which an outline is no circle (assumed; a square has 0.37)."""
LEVELS = np.linspace(0.2, 0.8, 13)
"""Shares of the step height at which the wall is evaluated: rounded edges are outside (assumed)."""
_ROUNDS = 50

Line = NDArray[np.float64]
"""(K, 2) x, y [m] of a closed contour; the last point is the first one."""


def outline_parameters(map_: HeightMap, step: Step | Refusal) -> Found:
    """Radius, roundness [m] and wall angle [rad] of the part on a map with its surroundings."""
    if isinstance(step, Refusal):
        return refused((*WALLS, *CIRCLES), f"no outline without a step: {step.reason}")
    if reason := missing("contourpy", "the outline"):
        return refused((*WALLS, *CIRCLES), reason)
    x, y = (np.arange(n, dtype=np.float64) * size for n, size in zip(map_.shape, (map_.dx, map_.dy), strict=True))
    rise = map_.z - (step.substrate[0] + step.substrate[1] * x[:, None] + step.substrate[2] * y)
    lines = [_contour(rise, x, y, share * step.ls) for share in (0.5, *LEVELS)]
    half = lines[0]
    if isinstance(half, Refusal):
        return refused((*WALLS, *CIRCLES), half.reason)
    return {**_wall(lines[1:], half, step.ls, max(map_.dx, map_.dy)), **_circle(half)}


def _contour(rise: FloatMap, x: NDArray[np.float64], y: NDArray[np.float64], height: float) -> Line | Refusal:
    """The one closed contour at a height."""
    from contourpy import LineType, contour_generator

    generator = contour_generator(x, y, np.ma.masked_invalid(rise.T), line_type=LineType.Separate)
    lines = generator.lines(height)
    where = f"the contour {height * UM_PER_M:.4g} µm above the substrate"
    if len(lines) != 1:
        return Refusal(f"{where} has {len(lines)} pieces; an outline has one")
    line = np.asarray(lines[0], np.float64)
    if not np.array_equal(line[0], line[-1]):
        return Refusal(f"{where} is not closed: it meets the edge of the map or cells without a height")
    return line


def _wall(lines: list[Line | Refusal], half: Line, height: float, pitch: float) -> Found:
    closed = [line for line in lines if not isinstance(line, Refusal)]
    if reasons := [line.reason for line in lines if isinstance(line, Refusal)]:
        return refused(WALLS, reasons[0])
    shift = (np.array([_area(line) for line in closed]) - _area(half)) / _length(half)
    heights = LEVELS * height
    width = float(shift[0] - shift[-1])
    if width < pitch:
        steepest = degrees(atan2(heights[-1] - heights[0], pitch))
        return refused(
            WALLS,
            f"the wall is narrower than one pitch of {pitch * UM_PER_M:.4g} µm, which cannot resolve it: it is steeper "
            f"than {steepest:.1f} deg",
        )
    terms = np.stack([np.ones_like(heights), heights], axis=-1)
    slopes = (np.polyfit(heights, shift, 1)[0], minimax(terms, shift)[0][1])
    return {symbol: atan2(1.0, -float(slope)) for symbol, slope in zip(WALLS, slopes, strict=True)}


def _circle(line: Line) -> Found:
    points, lengths = line[:-1], np.hypot(*np.diff(line, axis=0).T)
    centre, radius = least_squares_circle(points, (lengths + np.roll(lengths, 1)) / 2.0)
    roundness = float(np.ptp(_radii(points, centre)))
    if roundness > ROUND * radius:
        return refused(CIRCLES, f"the outline is no circle: its radius varies by {roundness / radius:.0%}")
    best, mean = minimum_zone_circle(points)
    return {
        "radius_ls": radius,
        "radius_mz": mean,
        "roundness_ls": roundness,
        "roundness_mz": float(np.ptp(_radii(points, best))),
    }


def least_squares_circle(
    points: NDArray[np.float64], weights: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.float64], float]:
    """Centre (2,) and radius with the smallest sum of squared radial distances (Gauss-Newton from the mean).

    points: (K, 2); weights: (K,), of an outline the length that belongs to each point.
    """
    share = np.ones(len(points)) if weights is None else weights
    root = np.sqrt(share)
    centre = points.mean(axis=0)
    for _ in range(_ROUNDS):
        radii = _radii(points, centre)
        terms = np.column_stack([np.ones(len(points)), (points - centre) / radii[:, None]])
        change = np.linalg.lstsq(terms * root[:, None], radii * root, rcond=None)[0][1:]
        centre = centre + change
        if np.abs(change).max() <= 1e-11 * radii.max():
            break
    return centre, float(np.average(_radii(points, centre), weights=share))


def minimum_zone_circle(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Centre (2,) and mean radius of the concentric circles with the smallest difference that enclose all points.

    Each round solves the problem with the distances linear in the centre, and halves a move that makes the zone wider.
    """
    centre = least_squares_circle(points)[0]
    radii = _radii(points, centre)
    for _ in range(_ROUNDS):
        terms = np.column_stack([np.ones(len(points)), (points - centre) / radii[:, None]])
        move = minimax(terms, radii)[0][1:]
        while np.ptp(_radii(points, centre + move)) >= np.ptp(radii) and np.abs(move).max() > 1e-13 * radii.max():
            move = move / 2.0
        if np.ptp(_radii(points, centre + move)) >= np.ptp(radii):
            break
        centre = centre + move
        radii = _radii(points, centre)
    return centre, float(radii.min() + radii.max()) / 2.0


def _radii(points: NDArray[np.float64], centre: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.hypot(*(points - centre).T), np.float64)


def _area(line: Line) -> float:
    x, y = (line - line[0]).T
    return float(abs(x[:-1] @ y[1:] - x[1:] @ y[:-1])) / 2.0


def _length(line: Line) -> float:
    return float(np.hypot(*np.diff(line, axis=0).T).sum())

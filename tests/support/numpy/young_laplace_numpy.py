"""Line bodies under surface tension once more: half-planes, sparse direct solves, lagged coefficients.

Independent of the C kernel but for the scheme (five points, arms cut at the footprint's edge, quarters of squares) and
the readings: the footprint comes from SciPy's convex hull by its half-planes, the nonlinear form is found by fixing the
coefficients and repeating, the points on the solid by starting over until all signs are right.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve
from scipy.spatial import ConvexHull

Map = NDArray[np.float64]
RAYS, STEP, NEAREST = 64, 0.25, 1e-3
SIDES = np.array([(-1, 0), (1, 0), (0, -1), (0, 1)])


def cap_radius(volume: float, angle: float) -> float:
    """Base radius [m] of a spherical cap of this volume [m3] and contact angle [rad]."""
    shape = np.pi * (2 - 3 * np.cos(angle) + np.cos(angle) ** 3) / (3 * np.sin(angle) ** 3)
    return float((volume / shape) ** (1 / 3))


def ends_of_rays(surface: Map, site: NDArray[np.float64], radius: float) -> Map:
    """(64, 2) places where the path over the surface is as long as the radius; all lengths in spacings."""
    angle = 2 * np.pi / RAYS
    length = radius * np.sqrt(angle / np.sin(angle))
    turns = np.arange(RAYS) * angle
    way = np.arange(0.0, length + 2 * STEP, STEP)
    along = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    places = site + along[:, None, :] * way[None, :, None]
    heights = map_coordinates(surface, places.reshape(-1, 2).T, order=1).reshape(RAYS, -1)
    path = np.concatenate([np.zeros((RAYS, 1)), np.cumsum(np.hypot(STEP, np.diff(heights)), axis=1)], axis=1)
    reached = np.array([np.interp(length, path[ray], way) for ray in range(RAYS)])
    return site + along * reached[:, None]


class Body:
    """Nodes and arms of one body above a solid, and its depth by fixed-point iteration; lengths in spacings."""

    def __init__(self, solid: Map, ends: Map) -> None:
        planes = ConvexHull(ends).equations  # normal . place + offset <= 0 inside
        low, high = np.floor(ends.min(axis=0)).astype(int), np.ceil(ends.max(axis=0)).astype(int) + 1
        grid = np.stack(np.meshgrid(*(np.arange(a, b) for a, b in zip(low, high, strict=True)), indexing="ij"), -1)
        places = grid.reshape(-1, 2)
        room = -(places @ planes[:, :2].T + planes[:, 2])  # to each half-plane
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = [np.where(planes[:, :2] @ side > 1e-15, room / (planes[:, :2] @ side), np.inf) for side in SIDES]
        distance = np.array([r.min(axis=1) for r in reach]).T
        inside = (room > 0).all(axis=1) & (distance > NEAREST).all(axis=1)
        self.places, self.arm = places[inside], np.minimum(distance[inside], 1.0)
        number = {tuple(place): k for k, place in enumerate(self.places)}
        self.next = np.array([[number.get((i + a, j + b), -1) for a, b in SIDES] for i, j in self.places])
        self.arm[self.next >= 0] = 1.0
        self.rise = np.stack([solid[tuple((self.places + side).T)] for side in SIDES], 1)
        self.rise -= solid[tuple(self.places.T)][:, None]

    def depths(self, volume: float, nonlinear: bool) -> Map:
        """Depth at each node; their sum is the volume."""
        w = self._at_rest(self._conductances(None), volume)
        for _ in range(400 if nonlinear else 0):
            new = self._at_rest(self._conductances(w), volume)
            change, w = np.abs(new - w).max(), new
            if change < 1e-10:
                return w
        assert not nonlinear, "lagged coefficients do not settle"
        return w

    def _conductances(self, w: Map | None) -> Map:
        """Flux through each half arm over its slope, (count, 4)."""
        weight = np.where(self.next < 0, self.arm, 0.5) * 0.5
        if w is None:
            return 2 * weight
        far = np.where(self.next < 0, 0.0, w[self.next])
        slope = self.rise + (far - w[:, None]) / self.arm
        shrink = {(x, y): 1 / np.sqrt(1 + slope[:, x] ** 2 + slope[:, y] ** 2) for x in (0, 1) for y in (2, 3)}
        sums = [
            shrink[0, 2] + shrink[0, 3],
            shrink[1, 2] + shrink[1, 3],
            shrink[0, 2] + shrink[1, 2],
            shrink[0, 3] + shrink[1, 3],
        ]
        return weight * np.stack(sums, axis=1)

    def _at_rest(self, conductance: Map, volume: float) -> Map:
        """Depths for fixed coefficients, not below 0."""
        count = len(self.places)
        matrix, load = self._system(conductance)
        wet = np.ones(count, dtype=bool)
        for _ in range(100):
            w = np.zeros(count)
            part = csr_array(matrix[wet][:, wet]).tocsc()
            still, per_pressure = spsolve(part, load[wet]), spsolve(part, np.ones(wet.sum()))
            pressure = (volume - still.sum()) / per_pressure.sum()
            w[wet] = still + pressure * per_pressure
            excess = matrix @ w - load - pressure
            change = (wet & (w < 0)) | (~wet & (excess < -1e-12))
            if not change.any():
                return w
            wet ^= change
        raise AssertionError("no set of points on the solid fits")

    def _system(self, conductance: Map) -> tuple[csr_array, Map]:
        """Matrix and load of: fluxes out of each node + pressure = 0, for the depths."""
        count = len(self.places)
        matrix, load = np.zeros((count, count)), np.zeros(count)
        for k in range(count):
            for side in range(4):
                q, arm, c = self.next[k, side], self.arm[k, side], conductance[k, side]
                load[k] += c * self.rise[k, side] / arm
                matrix[k, k] += c / arm**2
                if q >= 0:
                    load[q] -= c * self.rise[k, side] / arm
                    matrix[k, q] -= c / arm**2
                    matrix[q, k] -= c / arm**2
                    matrix[q, q] += c / arm**2
        return csr_array(matrix), load


def print_pass(
    surface: Map, drops: Map, lines: range, per_pitch: int, volume: float, angle: float, spacing: float, nonlinear: bool
) -> Map:
    """The fine surface [m] after a pass over some lines; drops (nx, ny), volume of one [m3], angle [rad]."""
    solid, after = surface / spacing, surface.copy()
    first = 2 * per_pitch + 2 + per_pitch / 2 - 0.5
    for line in lines:
        sites = np.flatnonzero(drops[:, line])
        for run in np.split(sites, np.flatnonzero(np.diff(sites) > 1) + 1) if len(sites) else []:
            places = first + per_pitch * np.stack([run, np.full(len(run), line)], axis=1)
            radii = [cap_radius(drops[i, line] * volume, angle) / spacing for i in run]
            body = Body(solid, np.concatenate([ends_of_rays(solid, p, r) for p, r in zip(places, radii, strict=True)]))
            depth = body.depths(drops[run, line].sum() * volume / spacing**3, nonlinear)
            after[tuple(body.places.T)] += depth * spacing
    return after

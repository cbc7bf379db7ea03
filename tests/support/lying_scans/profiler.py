"""The profiler of the rig, and all that may be wrong with its scans.

Faults apply in this order: geometry, height scale, datum, noise, spikes, drop-outs, whole-scan faults. Heights in um,
lengths in cells.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap
from support.lying_scans.places import across, continued, height_range, sampled

Scan: TypeAlias = tuple[FloatMap, BoolMap]
"""Readings [um] and whether each is valid, (nx, ny)."""

SPIKE_WALL_UM = 5.0  # range of 3 x 3 cells above which spikes prefer a cell (assumed)
TURNS: Mapping[str, Callable[[Any], Any]] = {
    "mirrored in x": lambda m: m[::-1],
    "mirrored in y": lambda m: m[:, ::-1],
    "transposed": lambda m: m.T,
    "turned by 90": lambda m: np.rot90(m, 1),
    "turned by 180": lambda m: np.rot90(m, 2),
    "turned by 270": lambda m: np.rot90(m, 3),
    "transposed and turned": lambda m: np.rot90(m, 2).T,
}
"""The orientations of a grid besides its own."""


@dataclass(frozen=True)
class Profiler:
    """Errors of the scans; none if not given.

    shift: the reading of cell (i, j) is the surface at (i, j) + shift; drift: what is added to it until the nominal end
    of the print; shift_std: of each scan; rotation [degrees], magnification, shear: the place is moved about the grid's
    middle by (1 + magnification) R(rotation) [[1, shear], [0, 1]]; spot: standard deviation of a Gaussian;
    gain: of heights; offset, tilt, bow: standard deviations, anew for every scan, of the six coefficients of
    1, u, w, u u, u w, w w with u and w from -1 to 1 over the grid [um]; noise, jitter: standard deviations of a reading
    and of a whole scan row, along axis jitter_axis [um]; step: readings are multiples of it [um]; spikes: share of the
    cells that are spike_height too high or too low [um], at walls if there are as many; walls_missing: range of 3 x 3
    cells above which a reading is missing [um]; dropouts: share of readings that are missing; missing_every: one scan
    of so many has no valid reading (0: none); frozen_from: the first scan that shows the one before again, and all
    after it (None: none); zero: all readings are 0; late: layers by which scans are late; turned: as in `TURNS`.
    """

    shift: tuple[float, float] = (0.0, 0.0)
    drift: tuple[float, float] = (0.0, 0.0)
    shift_std: float = 0.0
    rotation: float = 0.0
    magnification: float = 0.0
    shear: float = 0.0
    spot: float = 0.0
    gain: float = 1.0
    offset: float = 0.0
    tilt: float = 0.0
    bow: float = 0.0
    noise: float = 0.0
    jitter: float = 0.0
    jitter_axis: int = 0
    step: float = 0.0
    spikes: float = 0.0
    spike_height: float = 20.0
    walls_missing: float = np.inf
    dropouts: float = 0.0
    missing_every: int = 0
    frozen_from: int | None = None
    zero: bool = False
    late: int = 0
    turned: str | None = None


def read(profiler: Profiler, surface: FloatMap, layer: int, done: float, rng: np.random.Generator) -> Scan:
    """Scan number `layer`, counted from 0, without whole-scan faults; surface: (nx, ny) [um].

    done: share of the print that is over by the nominal number of layers, at most 1.
    """
    z = profiler.gain * displaced(profiler, surface, done, rng)
    z += _datum(profiler, surface.shape, rng)
    z += profiler.noise * rng.standard_normal(z.shape)
    rows = z.shape[profiler.jitter_axis]
    jitter = profiler.jitter * rng.standard_normal((rows, 1))
    z += jitter if profiler.jitter_axis == 0 else jitter.T
    if profiler.step > 0.0:
        z = profiler.step * np.round(z / profiler.step)
    steep = height_range(surface)
    if profiler.spikes > 0.0:
        z += _spikes(profiler, steep, rng)
    valid = (steep <= profiler.walls_missing) & (rng.random(z.shape) >= profiler.dropouts)
    if profiler.missing_every and layer % profiler.missing_every == profiler.missing_every - 1:
        valid[:] = False
    return z, valid


def shown(profiler: Profiler, scans: Sequence[Scan]) -> Scan:
    """The scan returned as the last of all scans so far: the right one, another, or a turned one."""
    layer = len(scans) - 1
    if profiler.frozen_from is not None:
        layer = min(layer, profiler.frozen_from - 1)
    z, valid = scans[max(layer - profiler.late, 0)]
    if profiler.zero:
        z, valid = np.zeros(z.shape), np.ones(z.shape, np.bool_)
    if profiler.turned is not None:
        turn = TURNS[profiler.turned]
        z, valid = (np.ascontiguousarray(turn(each)) for each in (z, valid))
    return z, valid


def displaced(profiler: Profiler, surface: FloatMap, done: float, rng: np.random.Generator) -> FloatMap:
    """The surface under a spot at the moved places, (nx, ny) [um]."""
    i, j = np.indices(surface.shape, np.float64)
    turn = np.deg2rad(profiler.rotation)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    linear = (1.0 + profiler.magnification) * rotation @ np.array([[1.0, profiler.shear], [0.0, 1.0]])
    middle = [(count - 1) / 2 for count in surface.shape]
    shift = np.add(profiler.shift, np.multiply(done, profiler.drift)) + profiler.shift_std * rng.standard_normal(2)
    di, dj = i - middle[0], j - middle[1]
    x = middle[0] + linear[0, 0] * di + linear[0, 1] * dj + shift[0]
    y = middle[1] + linear[1, 0] * di + linear[1, 1] * dj + shift[1]
    return sampled(_blurred(surface, profiler.spot), x, y)


def _blurred(surface: FloatMap, spot: float) -> FloatMap:
    if spot == 0.0:
        return surface
    reach = int(np.ceil(4.0 * spot))
    weights = np.exp(-((np.arange(-reach, reach + 1) / spot) ** 2) / 2.0)
    weights /= weights.sum()
    wide = continued(surface, reach)
    for axis in (0, 1):
        wide = np.apply_along_axis(np.convolve, axis, wide, weights, "valid")
    return wide


def _datum(profiler: Profiler, shape: tuple[int, int], rng: np.random.Generator) -> FloatMap:
    u, w = across(shape)
    terms = np.stack([np.ones(shape), u, w, u * u, u * w, w * w])
    std = np.array([profiler.offset, *2 * [profiler.tilt], *3 * [profiler.bow]])
    return np.asarray(np.tensordot(std * rng.standard_normal(6), terms, 1))


def _spikes(profiler: Profiler, steep: FloatMap, rng: np.random.Generator) -> FloatMap:
    """As many cells as asked for, walls first, in random order."""
    preference = np.where(steep > SPIKE_WALL_UM, 0.0, 1.0) + rng.random(steep.shape)
    chosen = np.argsort(preference, axis=None)[: round(profiler.spikes * steep.size)]
    spikes = np.zeros(steep.size)
    spikes[chosen] = profiler.spike_height * rng.choice((-1.0, 1.0), chosen.size)
    return spikes.reshape(steep.shape)

"""The propagation of volume and area of Wu and Chiu (2024), equation by equation, drop by drop, in the paper's units.

Heights in um, volumes v in drops, areas a in cells, coefficients per um.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from support.numpy import caps_numpy

C = 7.0751
COEFFICIENTS = {"mv_plus": 0.0067, "mv_minus": -0.0201, "ma_plus": 0.0, "ma_minus": -0.0634}
PITCH = 90.0


def roi(shape: tuple[int, int], i: int, j: int) -> tuple[slice, slice]:
    """The 3 x 3 cells around (i, j), cut to the grid."""
    return slice(max(i - 1, 0), min(i + 2, shape[0])), slice(max(j - 1, 0), min(j + 2, shape[1]))


def heights(v: Any, a: Any, c: float = C) -> Any:
    """Equation 2, 0 on bare cells."""
    return np.divide(c * v, a, out=np.zeros_like(v), where=a > 0)


def differences(h: Any) -> Any:
    """Equations 7 to 9 of all cells of a ROI: height less the mean of the cells of the ROI that touch it."""
    found = np.zeros_like(h)
    for cell in np.ndindex(h.shape):
        block = h[roi(h.shape, *cell)]
        if block.size > 1:
            found[cell] = h[cell] - (block.sum() - h[cell]) / (block.size - 1)
    return found


def cap_shares(radius: float, c: float = C, pitch: float = PITCH) -> tuple[Any, Any]:
    """Volume and area shares (3, 3) of a drop on flat ground; the volumes sum to 1."""
    height = caps_numpy.height_of(c * pitch**2, radius)
    parts = np.array(
        [
            [caps_numpy.over(radius, height, abs(p) * pitch, abs(q) * pitch, pitch) for q in (-1, 0, 1)]
            for p in (-1, 0, 1)
        ]
    )
    return parts[..., 0] / parts[..., 0].sum(), np.minimum(parts[..., 1] / pitch**2, 1.0)


def drop(
    v: Any,
    a: Any,
    substrate: Any,
    i: int,
    j: int,
    volume: float,
    shares: tuple[Any, Any],
    *,
    c: float = C,
    guard: bool = False,
    limit: bool = False,
    mv_plus: float = 0.0067,
    mv_minus: float = -0.0201,
    ma_plus: float = 0.0,
    ma_minus: float = -0.0634,
) -> None:
    """One drop on cell (i, j), in place (equations 10 to 13)."""
    region = roi(v.shape, i, j)
    hit = (i - region[0].start, j - region[1].start)
    rise = differences(heights(v, a, c)[region] + substrate[region])
    if np.abs(rise).max() <= 1e-9:
        places = np.ix_(
            np.arange(region[0].start, region[0].stop) - i + 1, np.arange(region[1].start, region[1].stop) - j + 1
        )
        gain, spread = shares[0][places].copy(), shares[1][places]
        gain[hit] += 1.0 - gain.sum()
        v[region] += volume * gain
        a[region] = np.minimum(a[region] + spread, 1.0)
        return
    gain = np.where(rise > 0, mv_plus, mv_minus) * rise
    gain[hit] = 0.0
    if limit and gain.sum() > 1.0:
        gain /= gain.sum()
    area = a[region] + np.where(rise > 0, ma_plus, ma_minus) * rise
    if guard:
        grows = (rise > 0) & (gain > 0) & (v[region] > 0)
        stays = a[region] * (1.0 + np.divide(volume * gain, v[region], out=np.zeros_like(gain), where=grows))
        area = np.where(grows, np.maximum(area, stays), area)
    gain[hit] = 1.0 - gain.sum()
    v[region] += volume * gain
    a[region] = np.clip(area, 0.0, 1.0)
    a[i, j] = 1.0


def cells_in_order(shape: tuple[int, int], order: int, passes: list[tuple[int, int]] | None) -> list[tuple[int, int]]:
    """Cells in the order of their drops: 1 line by line, 2 to and fro, 3 along i first; colour by colour if given."""
    cells = [(int(i), int(j)) for i, j in np.ndindex(shape)]
    if order == 2:
        cells = [(i, j if i % 2 == 0 else shape[1] - 1 - j) for i, j in cells]
    if order == 3:
        cells.sort(key=lambda cell: cell[::-1])
    if passes is None:
        return cells
    return [(i, j) for colour in passes for i, j in cells if (i % 2, j % 2) == colour]

"""Height, hybrid and material ratio parameters of ISO 25178-2 over the cells that count.

Heights z are those of the N cells, counted from their mean, each of the same area. Gradients live on the squares
between four such neighbours (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1): each is divided into two triangles in
both of its ways, so that the result does not depend on the direction of a diagonal.

    Sa = sum |z| / N            Sq = sqrt(sum z^2 / N)      Sp = max z       Sv = -min z      Sz = Sp + Sv
    Ssk = sum z^3 / (N Sq^3)    Sku = sum z^4 / (N Sq^4)
    Sdq = sqrt(mean of |grad z|^2 over the triangles)
    Sdr = mean of sqrt(1 + |grad z|^2) - 1 over the triangles

The material ratio curve (Abbott curve) c(p) is the height that a share p of the cells reaches or exceeds: the sorted
heights stand at p = (k - 1/2) / N, between them it is linear. Volumes per area at a height c are sums over the cells,
not over the curve:

    Vm(p) = mean of max(z - c(p), 0)        Vv(p) = mean of max(c(p) - z, 0)
    Vmp = Vm(10 %)    Vmc = Vm(80 %) - Vm(10 %)    Vvc = Vv(10 %) - Vv(80 %)    Vvv = Vv(80 %)

The equivalent line is fitted by least squares to the 40 % of the curve whose secant falls least (the first of several).
It has the heights h1 at p = 0 and h2 at p = 1; Smr1 and Smr2 are where the curve reaches them:

    Sk = h1 - h2    Spk = 2 mean of max(z - h1, 0) / Smr1    Svk = 2 mean of max(h2 - z, 0) / (1 - Smr2)

Spk and Svk are the heights of right triangles with the area of the peaks and of the pits.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.metrology.evaluation.surface import Found, Refusal, Surface, refused

CORE = 0.4
"""Share of the curve that the equivalent line is fitted to (ISO 25178-2)."""
PEAKS, PITS = 0.1, 0.8
"""Material ratios that separate peaks, core and pits of the volumes (defaults of ISO 25178-3)."""


def height_parameters(surface: Surface) -> Found:
    """Sa, Sq, Sz, Sp, Sv [m], Ssk, Sku [1]."""
    z = surface.heights
    sq = float(np.sqrt(np.mean(z**2)))
    lengths: dict[str, float | Refusal] = {
        "Sa": float(np.mean(np.abs(z))),
        "Sq": sq,
        "Sz": float(np.ptp(z)),
        "Sp": float(z.max()),
        "Sv": float(-z.min()),
    }
    if sq == 0.0:
        return {**lengths, **refused(("Ssk", "Sku"), "the surface is flat, its heights have no distribution")}
    return lengths | {"Ssk": float(np.mean((z / sq) ** 3)), "Sku": float(np.mean((z / sq) ** 4))}


def hybrid_parameters(surface: Surface) -> Found:
    """Sdq, Sdr [1]."""
    z, used = surface.z, surface.used
    whole = used[:-1, :-1] & used[1:, :-1] & used[:-1, 1:] & used[1:, 1:]
    if not whole.any():
        return refused(("Sdq", "Sdr"), "no four neighbouring cells have heights, from which a slope follows")
    along_x, along_y = np.diff(z, axis=0) / surface.dx, np.diff(z, axis=1) / surface.dy
    by_x = [along_x[:, :-1][whole], along_x[:, 1:][whole]]
    by_y = [along_y[:-1][whole], along_y[1:][whole]]
    squares = np.array([x**2 + y**2 for x in by_x for y in by_y])  # of the four triangles' gradients
    return {
        "Sdq": float(np.sqrt(squares.mean())),
        "Sdr": float(np.mean(squares / (np.sqrt(1.0 + squares) + 1.0))),
    }


def material_ratio_parameters(surface: Surface) -> Found:
    """Sk, Spk, Svk, Vmp, Vmc, Vvc, Vvv [m], Smr1, Smr2 [1]."""
    falling = np.sort(surface.heights)[::-1]
    return _core(falling) | _volumes(falling)


def _volumes(z: NDArray[np.float64]) -> dict[str, float]:
    high, low = np.quantile(z, [1.0 - PEAKS, 1.0 - PITS], method="hazen")
    material = [float(np.maximum(z - height, 0.0).mean()) for height in (high, low)]
    void = [float(np.maximum(height - z, 0.0).mean()) for height in (high, low)]
    return {"Vmp": material[0], "Vmc": material[1] - material[0], "Vvc": void[0] - void[1], "Vvv": void[1]}


def _core(z: NDArray[np.float64]) -> dict[str, float]:
    share = (np.arange(z.size) + 0.5) / z.size
    starts = share[share + CORE <= share[-1]]
    falls = z[: starts.size] - np.interp(starts + CORE, share, z)
    first = int(np.argmin(falls))
    window = (share >= starts[first]) & (share <= starts[first] + CORE)
    p, heights = share[window] - share[window].mean(), z[window]
    slope = float(p @ heights / (p @ p))
    top = float(heights.mean() - slope * share[window].mean())
    bottom = top + slope
    peaks, pits = float(np.maximum(z - top, 0.0).mean()), float(np.maximum(bottom - z, 0.0).mean())
    smr1 = float(np.interp(-top, -z, share)) if peaks > 0.0 else 0.0
    smr2 = float(np.interp(-bottom, -z, share)) if pits > 0.0 else 1.0
    return {
        "Sk": top - bottom,
        "Spk": 2.0 * peaks / smr1 if peaks > 0.0 else 0.0,
        "Svk": 2.0 * pits / (1.0 - smr2) if pits > 0.0 else 0.0,
        "Smr1": smr1,
        "Smr2": smr2,
    }

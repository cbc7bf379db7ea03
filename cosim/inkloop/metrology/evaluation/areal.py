"""Height, spatial, hybrid and material ratio parameters of ISO 25178-2 over the cells that count.

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

Spatial parameters come from the autocorrelation f(t), the mean of z(r) z(r + t) over the pairs of cells that both
count, divided by Sq^2. A lag counts if at least a quarter of the cells have a partner:

    Sal: the shortest lag at which f falls to 0.2     Str = Sal / the longest lag, along a ray, at which it first does
    Std: the direction of the lay, at a right angle to that in which the angular spectrum has its maximum

The spectrum is the Fourier transform of f under a round Hann window, so that the mask's shape does not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.component import FloatMap
from inkloop.metrology.evaluation.surface import Found, Refusal, Surface, refused
from inkloop.units import UM_PER_M

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


DECAY = 0.2
"""Level of the autocorrelation (default of ISO 25178-3)."""
PAIRS_MIN = 0.25
"""Share of the cells that must have a partner at a lag (assumed)."""
PROMINENCE = 2.0
"""Least ratio of the maximum of the angular spectrum to its mean for a direction. A Gaussian texture of Str 0.5 has
it."""
RAYS = 180
"""Directions over half a turn: one degree."""
STEPS_MIN = 5
_SYMBOLS = ("Sal", "Str", "Std")
_FINE = 4  # samples of a ray in one step


def spatial_parameters(surface: Surface) -> Found:
    """Sal [m], Str [1], Std [rad] from x towards y, in [0, pi)."""
    from scipy.ndimage import label

    pieces = int(label(surface.mask, np.ones((3, 3)))[1])
    if pieces > 1:
        return refused(_SYMBOLS, f"the mask has {pieces} pieces, which share no texture; evaluate one of them")
    if not surface.z.any():
        return refused(_SYMBOLS, "the surface is flat")
    correlation, pairs = autocorrelation(surface)
    known = pairs >= PAIRS_MIN * surface.used.sum()
    lengths, ends = _decays(correlation, known, surface)
    return {**_lengths(lengths, ends, surface), "Std": _direction(correlation, float(ends.min()), surface)}


def autocorrelation(surface: Surface) -> tuple[FloatMap, FloatMap]:
    """f(t) and the number of pairs at the lags -(m - 1) ... m - 1 and -(n - 1) ... n - 1 of the m x n cells that hold
    all that count.
    """
    from scipy.fft import irfft2, next_fast_len, rfft2

    rows, columns = (np.flatnonzero(surface.used.any(axis=axis)) for axis in (1, 0))
    inside = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
    z, used = surface.z[inside], surface.used[inside]
    shape = z.shape
    size = [next_fast_len(2 * n - 1, real=True) for n in shape]

    def lagged(values: FloatMap) -> FloatMap:
        products = irfft2(np.abs(rfft2(values, size)) ** 2, size)
        centred = np.roll(products, [n - 1 for n in shape], axis=(0, 1))
        return np.asarray(centred[: 2 * shape[0] - 1, : 2 * shape[1] - 1], np.float64)

    scale = float(np.sqrt(np.mean(surface.heights**2)))
    pairs = np.rint(lagged(used.astype(np.float64)))
    return lagged(z / scale) / np.maximum(pairs, 1.0), pairs


def _decays(
    correlation: FloatMap, known: NDArray[np.bool_], surface: Surface
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(RAYS,) lag [m] at which f first falls to DECAY along each ray, NaN where it does not; last known lag [m]."""
    from scipy.ndimage import map_coordinates

    middle, angles = np.array(correlation.shape) // 2, np.arange(RAYS)[:, None] * np.pi / RAYS
    along_i, along_j = np.cos(angles) / surface.dx, np.sin(angles) / surface.dy
    step = 1.0 / (_FINE * np.maximum(np.abs(along_i), np.abs(along_j)))  # (RAYS, 1): _FINE samples from cell to cell
    radius = np.arange(_FINE * max(middle) + 1) * step
    i, j = middle[0] + along_i * radius, middle[1] + along_j * radius
    values = map_coordinates(correlation, [i, j], order=1, mode="nearest")
    is_known = map_coordinates(known.astype(np.float32), [i, j], order=1, mode="constant") > 1.0 - 1e-3
    last = np.where(is_known.all(axis=1), radius.shape[1], np.argmin(is_known, axis=1)) - 1
    below = (values <= DECAY) & (np.arange(radius.shape[1]) <= last[:, None])
    crossed, k = below.any(axis=1), np.argmax(below, axis=1)
    rays = np.arange(RAYS)
    upper, lower = values[rays, np.maximum(k - 1, 0)], values[rays, k]
    share = np.divide(upper - DECAY, upper - lower, out=np.zeros(RAYS), where=crossed)
    return np.where(crossed, (k - 1 + share) * step[:, 0], np.nan), radius[rays, last]


def _lengths(lengths: NDArray[np.float64], ends: NDArray[np.float64], surface: Surface) -> dict[str, float | Refusal]:
    open_ = np.isnan(lengths)
    if open_.all():
        longest = f"{ends.max() * UM_PER_M:.4g} µm, the longest lag"
        reason = f"the autocorrelation does not fall to {DECAY:g} within {longest}"
        return {"Sal": Refusal(reason), "Str": Refusal(reason)}
    shortest = float(np.nanmin(lengths))
    if shortest < min(surface.dx, surface.dy):
        reason = "neighbouring cells are hardly correlated: Sal is below one pitch, which cannot resolve it"
        return {"Sal": Refusal(reason), "Str": Refusal(reason)}
    if open_.any() and float(ends[open_].min()) < shortest:
        reason = "the cells that count are too narrow in one direction to follow the autocorrelation to its end"
        return {"Sal": Refusal(reason), "Str": Refusal(reason)}
    if open_.any():
        reach = float(ends[open_].max())
        ray = int(np.flatnonzero(open_)[np.argmax(ends[open_])])
        reason = (
            f"along {ray * 180 // RAYS} deg the autocorrelation does not fall to {DECAY:g} within "
            f"{reach * UM_PER_M:.4g} µm, the longest lag: Str is below {shortest / reach:.2g}"
        )
        return {"Sal": shortest, "Str": Refusal(reason)}
    return {"Sal": shortest, "Str": shortest / float(np.nanmax(lengths))}


def _direction(correlation: FloatMap, reach: float, surface: Surface) -> float | Refusal:
    """The lay, from the maximum of the angular spectrum over directions of waves."""
    from scipy.fft import fft2, fftshift, ifftshift
    from scipy.ndimage import map_coordinates

    coarsest = max(surface.dx, surface.dy)
    if reach < STEPS_MIN * coarsest:
        return Refusal(f"the longest lag in the narrowest direction is {reach / coarsest:.1f} steps; needs {STEPS_MIN}")
    middle = np.array(correlation.shape) // 2
    x = (np.arange(correlation.shape[0]) - middle[0]) * surface.dx
    y = (np.arange(correlation.shape[1]) - middle[1]) * surface.dy
    lag = np.hypot(x[:, None], y) / reach
    window = np.where(lag < 1.0, 0.5 + 0.5 * np.cos(np.pi * np.minimum(lag, 1.0)), 0.0)
    power = fftshift(fft2(ifftshift(correlation * window)).real)
    frequency = np.arange(1.0 / reach, 0.5 / coarsest, 0.25 / reach)
    angles = np.arange(RAYS) * np.pi / RAYS
    i = middle[0] + np.cos(angles)[:, None] * frequency * (correlation.shape[0] * surface.dx)
    j = middle[1] + np.sin(angles)[:, None] * frequency * (correlation.shape[1] * surface.dy)
    spectrum = (map_coordinates(power, [i, j], order=1) * frequency).sum(axis=1)
    if not spectrum.max() >= PROMINENCE * spectrum.mean():
        return Refusal("no direction stands out: the angular spectrum is nowhere twice its mean")
    return float((np.argmax(spectrum) + RAYS // 2) % RAYS * np.pi / RAYS)

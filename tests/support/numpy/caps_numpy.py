"""Spherical caps over the cells of a grid, integrated by SciPy's adaptive quadrature, cell by cell."""

from __future__ import annotations

import itertools
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.integrate import quad


def volume(radius: float, height: float) -> float:
    """Volume of the cap of a base radius and a height."""
    return np.pi / 6 * height * (3 * radius**2 + height**2)


def height_of(whole: float, radius: float) -> float:
    """Height of the cap of a volume on a base radius: the real root of a^3 + 3 r^2 a = 6 V / pi."""
    roots = np.roots([1.0, 0.0, 3 * radius**2, -6 * whole / np.pi])
    return float(roots[np.abs(roots.imag) < 1e-9 * radius].real[0])


@lru_cache
def over(radius: float, height: float, x: float, y: float, side: float) -> tuple[float, float]:
    """Volume and base area of the cap over a square around (x, y); across the inner direction in closed form."""
    sphere = (radius**2 + height**2) / (2 * height)

    def chord(at: float) -> tuple[float, float]:
        half = np.sqrt(max(radius**2 - at**2, 0.0))
        return max(y - side / 2, -half), min(y + side / 2, half)

    def width(at: float) -> float:
        low, high = chord(at)
        return max(high - low, 0.0)

    def primitive(at: float, t: float) -> float:
        square = sphere**2 - at**2
        root = np.sqrt(max(square - t**2, 0.0))
        return 0.5 * (t * root + square * np.arctan2(t, root)) - (sphere - height) * t

    def section(at: float) -> float:
        low, high = chord(at)
        return primitive(at, high) - primitive(at, low) if high > low else 0.0

    low, high = max(x - side / 2, -radius), min(x + side / 2, radius)
    if high <= low:
        return 0.0, 0.0
    edges = [np.sqrt(radius**2 - t**2) for t in (y - side / 2, y + side / 2) if abs(t) < radius]
    cuts = sorted({low, high, *(s * e for e in edges for s in (-1, 1) if low < s * e < high)})
    pieces = list(itertools.pairwise(cuts))
    scale = height * radius**2
    return (
        sum(quad(section, a, b, epsabs=1e-13 * scale, epsrel=1e-13)[0] for a, b in pieces),
        sum(quad(width, a, b, epsabs=1e-13 * radius**2, epsrel=1e-13)[0] for a, b in pieces),
    )


def layer(surface: Any, pattern: Any, caps: Any, pitch: float, factor: Any) -> tuple[Any, float]:
    """The surface after a layer of caps ((radius, height) of A and of B), and the height that left the grid."""
    reach = max(int(np.ceil(radius / pitch)) for radius, _ in caps)
    grown = np.pad(np.zeros_like(surface), reach)
    nx, ny = surface.shape
    for material, (radius, height) in enumerate(caps, start=1):
        drops = np.where(pattern == material, factor, 0.0)
        for di in range(-reach, reach + 1):
            for dj in range(-reach, reach + 1):
                part, _ = over(radius, height, abs(di) * pitch, abs(dj) * pitch, pitch)
                grown[reach + di : reach + di + nx, reach + dj : reach + dj + ny] += drops * part / pitch**2
    inside = grown[reach:-reach, reach:-reach]
    return surface + inside, float(grown.sum() - inside.sum())

"""Height and hybrid parameters of ISO 25178-2 over the cells that count.

Heights z are those of the N cells, counted from their mean, each of the same area. Gradients live on the squares
between four such neighbours (i, j), (i + 1, j), (i, j + 1), (i + 1, j + 1): each is divided into two triangles in
both of its ways, so that the result does not depend on the direction of a diagonal.

    Sa = sum |z| / N            Sq = sqrt(sum z^2 / N)      Sp = max z       Sv = -min z      Sz = Sp + Sv
    Ssk = sum z^3 / (N Sq^3)    Sku = sum z^4 / (N Sq^4)
    Sdq = sqrt(mean of |grad z|^2 over the triangles)
    Sdr = mean of sqrt(1 + |grad z|^2) - 1 over the triangles
"""

from __future__ import annotations

import numpy as np

from inkloop.metrology.evaluation.surface import Found, Refusal, Surface, refused


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

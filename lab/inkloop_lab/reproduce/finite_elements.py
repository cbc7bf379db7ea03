"""Liquid bodies by finite elements with scikit-fem: the method of the paper, which uses MATLAB, to compare with our
kernel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial import Delaunay

from inkloop.component import FloatMap

NEWTON_MAX, NEWTON_TOLERANCE, RUN_AWAY = 40, 1e-9, 1e3


@dataclass(frozen=True, eq=False)
class Solution:
    """places: (n, 2) nodes, height: (n,) over the plane z = 0, all in the unit of the outline; elements: triangles."""

    places: FloatMap
    height: FloatMap
    elements: int
    basis: Any
    values: FloatMap

    def at(self, places: FloatMap) -> FloatMap:
        """Heights at places (m, 2) within the outline."""
        found: FloatMap = self.basis.probes(places.T) @ self.values
        return found


def triangles(outline: FloatMap, size: float) -> tuple[FloatMap, FloatMap]:
    """Nodes (n, 2) and triangles (m, 3) of the convex region in `outline` (k, 2), edges about `size` long."""
    ahead = np.roll(outline, -1, axis=0)
    border = [
        start + (end - start) * step[:, None]
        for start, end in zip(outline, ahead, strict=True)
        for step in [
            np.arange(max(1, round(float(np.hypot(*(end - start))) / size)))
            / max(1, round(float(np.hypot(*(end - start))) / size))
        ]
    ]
    low, high = outline.min(axis=0) - size, outline.max(axis=0) + size
    rows = np.arange(low[1], high[1], size * np.sqrt(0.75))
    lattice = np.array(
        [(x + 0.5 * size * (k % 2), y) for k, y in enumerate(rows) for x in np.arange(low[0], high[0], size)]
    )
    edges = ahead - outline
    away = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(*edges.T)[:, None]
    orientation = np.sign(np.sum(outline[:, 0] * ahead[:, 1] - ahead[:, 0] * outline[:, 1]))
    outside = orientation * ((lattice[:, None, :] - outline) * away).sum(axis=2)
    nodes = np.concatenate([*border, lattice[(outside < -0.5 * size).all(axis=1)]])
    found = Delaunay(nodes).simplices
    corners = nodes[found]
    one, other = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = 0.5 * np.abs(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
    return nodes, found[area > 1e-6 * size**2]


def solve(
    outline: FloatMap,
    volume: float,
    size: float,
    *,
    form: Literal["linear", "nonlinear"] = "nonlinear",
    order: Literal[1, 2] = 1,
    ground: Callable[[FloatMap], FloatMap] | None = None,
) -> Solution:
    """The surface of constant mean curvature that holds a volume over the ground within a convex outline (k, 2).

    ground: heights at places (n, 2), level if not given; the surface may dip below it, as in the paper. Newton on
    heights and pressure together, the linear form in one step. Raises RuntimeError where there is no such surface.
    """
    import skfem

    nodes, found = triangles(outline, size)
    mesh = skfem.MeshTri(nodes.T.copy(), found.T.copy())
    basis = skfem.Basis(mesh, skfem.ElementTriP1() if order == 1 else skfem.ElementTriP2())
    border, inner = basis.get_dofs(), basis.complement_dofs(basis.get_dofs())
    solid = np.zeros(basis.N) if ground is None else ground(basis.doflocs.T)
    values = np.zeros(basis.N)
    values[border.all()] = solid[border.all()]
    load = skfem.LinearForm(_one).assemble(basis)
    pressure, steps = 0.0, 1 if form == "linear" else NEWTON_MAX
    for step in range(steps):
        linear = form == "linear" or step == 0  # Newton's method begins from the linear form's surface
        stiffness = skfem.BilinearForm(_laplace if linear else _tangent)
        residual = skfem.LinearForm(_slope if linear else _curvature)
        before = basis.interpolate(values)
        matrix = stiffness.assemble(basis, before=before)
        force = pressure * load - residual.assemble(basis, before=before)
        change, rise = _bordered(matrix[inner][:, inner], load[inner], force[inner], volume + load @ (solid - values))
        values[inner] += change
        pressure += rise
        if not np.isfinite(values).all() or np.abs(values).max() > RUN_AWAY * np.abs(solid).max() + RUN_AWAY * size:
            raise RuntimeError("no nonlinear surface: Newton runs away")
        if step > 0 and np.abs(change).max() <= NEWTON_TOLERANCE * max(1.0, float(np.abs(values).max())):
            break
    else:
        if form == "nonlinear":
            raise RuntimeError(f"no nonlinear surface after {NEWTON_MAX} steps of Newton")
    return Solution(nodes, values[basis.nodal_dofs[0]], len(found), basis, values)


def _bordered(matrix: Any, load: FloatMap, force: FloatMap, missing: float) -> tuple[FloatMap, float]:
    """Change of heights and of pressure: matrix change - load rise = force, load change = missing volume."""
    from scipy.sparse.linalg import splu

    factor = splu(matrix.tocsc())
    by_force, by_load = factor.solve(force), factor.solve(load)
    rise = (missing - load @ by_force) / (load @ by_load)
    return by_force + rise * by_load, float(rise)


def _one(v: Any, w: Any) -> Any:
    return v


def _laplace(u: Any, v: Any, w: Any) -> Any:
    return (u.grad * v.grad).sum(axis=0)


def _slope(v: Any, w: Any) -> Any:
    return (w.before.grad * v.grad).sum(axis=0)


def _curvature(v: Any, w: Any) -> Any:
    slope = w.before.grad
    return (slope * v.grad).sum(axis=0) / np.sqrt(1.0 + (slope**2).sum(axis=0))


def _tangent(u: Any, v: Any, w: Any) -> Any:
    slope = w.before.grad
    root = np.sqrt(1.0 + (slope**2).sum(axis=0))
    along = (slope * u.grad).sum(axis=0) * (slope * v.grad).sum(axis=0)
    return (u.grad * v.grad).sum(axis=0) / root - along / root**3

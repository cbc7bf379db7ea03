"""The layer-to-layer map in CasADi, for problems that are written in terms of it."""

from __future__ import annotations

from typing import Any, TypeAlias

import casadi as ca

Symbolic: TypeAlias = Any
"""A CasADi matrix (MX, SX or DM), or a number where one will do."""

SIDES = ((-1, 0), (0, -1), (0, 1), (1, 0))
CORNERS = ((-1, -1), (-1, 1), (1, -1), (1, 1))


def symbolic_layer(H: Symbolic, U: Symbolic, h1: Symbolic, h2: Symbolic, h3: Symbolic) -> Symbolic:
    """Surface after one pass over the surface H (Lu, Zheng, Mishra 2015, eq. 3-7), open edge.

    H: (nx, ny) heights; U: (nx, ny) droplets, relaxed to 0..1; h1, h2, h3: the ink of each cell's droplet in the unit
    of H, numbers or (nx, ny). Linear in U; clipped, hence not smooth, in H.
    """
    kept, given = symbolic_shares(H, U, h1, h2, h3)
    return H + kept + given


def symbolic_shares(H: Symbolic, U: Symbolic, h1: Symbolic, h2: Symbolic, h3: Symbolic) -> tuple[Symbolic, Symbolic]:
    """Height that droplets of symbolic_layer leave on their own cells, and that cells get from their neighbours'."""
    kept, given = h1 * U, ca.DM.zeros(H.shape)
    for neighbours, spread in ((SIDES, h2), (CORNERS, h3)):
        for di, dj in neighbours:
            inside = _shifted(ca.DM.ones(H.shape), di, dj)
            rise = inside * (H - _shifted(H, di, dj))
            taken = spread * ca.fmax(0, ca.fmin(1, 1 + rise / (h1 + spread)))
            kept += (spread - taken) * U
            given += _shifted(taken * U, -di, -dj)
    return kept, given


def _shifted(M: Symbolic, di: int, dj: int) -> Symbolic:
    """Cell (i, j) of the result is cell (i + di, j + dj) of M, zero where that lies outside."""
    nx, ny = M.shape
    rows = ca.DM.zeros(1, ny)
    if di:
        M = ca.vertcat(M[1:, :], rows) if di > 0 else ca.vertcat(rows, M[:-1, :])
    columns = ca.DM.zeros(nx, 1)
    if dj:
        M = ca.horzcat(M[:, 1:], columns) if dj > 0 else ca.horzcat(columns, M[:, :-1])
    return M

"""Meshes as columns: read, placed on the grid, filled where the winding number of the surface is above 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from inkloop.errors import GeometryError, nearest
from inkloop.geometry.body import Body, Placement, bounds
from inkloop.geometry.columns import Columns
from inkloop.geometry.mesh_columns import MeshColumns, left_by_cuts, mesh_columns
from inkloop.geometry.mesh_file import read_bodies
from inkloop.limits import memory_error
from inkloop.units import MM_PER_M

OPEN_MAX = 1e-3
"""Share of the occupied columns that may be open where neighbours fill them, or inside out (assumed)."""
_SHOWN = 3
_SIDES = ((-1, 0), (0, -1), (0, 1), (1, 0))
OpenColumns = Literal["refuse", "neighbours"]


def load(
    path: Path | str,
    nx: int,
    ny: int,
    pitch: float,
    *,
    unit: str | None = None,
    placement: Placement | None = None,
    open_columns: OpenColumns = "refuse",
) -> Columns:
    """The part in a mesh file (STL, OBJ, PLY, 3MF), all bodies as one, over nx x ny cells of `pitch` [m].

    unit: of the coordinates: um, mm, cm, m, in, ft; only 3MF states its own. open_columns: "neighbours" fills columns
    that holes of the surface leave open, at most 0.1 % of those occupied. Raises GeometryError.
    """
    bodies = _placed(path, unit, placement, nx, ny, pitch)
    return closed_columns(str(path), bodies, nx, ny, pitch, open_columns).columns


def load_inks(
    path: Path | str,
    nx: int,
    ny: int,
    pitch: float,
    inks: Mapping[str, str],
    *,
    unit: str | None = None,
    placement: Placement | None = None,
    open_columns: OpenColumns = "refuse",
) -> dict[str, Columns]:
    """The part in a mesh file as one region for each ink, placed together; otherwise as `load`.

    inks: name of an object or of a material -> ink; every body needs one, the name of the object counts first.
    """
    bodies = _placed(path, unit, placement, nx, ny, pitch)
    return {
        ink: closed_columns(f"{path}, ink {ink}", found, nx, ny, pitch, open_columns).columns
        for ink, found in bodies_by_ink(str(path), bodies, inks).items()
    }


def bodies_by_ink(source: str, bodies: Sequence[Body], inks: Mapping[str, str]) -> dict[str, list[Body]]:
    """The bodies of each ink by the name of their object or material. Raises GeometryError."""
    by_ink: dict[str, list[Body]] = {ink: [] for ink in inks.values()}
    used, errors = set(), []
    for body in bodies:
        name = next((name for name in (body.name, body.material) if name in inks), None)
        if name is None and body.paint:
            errors.append(f"{painted(body)}: make each material an object of its own, or name this one in inks")
            used |= {*body.paint}
        elif name is None:
            errors.append(f"object {body.name!r} of material {body.material!r} has no ink; name one of them in inks")
        else:
            used.add(name)
            by_ink[inks[name]].append(body)
    known = {name for body in bodies for name in (body.name, body.material) if name}
    errors += [
        f"inks: no object or material is called {name!r}; {nearest(name, known)}" for name in sorted(set(inks) - used)
    ]
    if errors:
        raise GeometryError(f"{source}: " + "; ".join(errors))
    return by_ink


def painted(body: Body) -> str:
    """Description of a body whose triangles have several materials, for a person."""
    names = ", ".join(repr(name) if name else "none" for name in body.paint)
    return f"object {body.name!r} has triangles of several materials ({names}), but an object is of one ink"


def _placed(
    path: Path | str, unit: str | None, placement: Placement | None, nx: int, ny: int, pitch: float
) -> tuple[Body, ...]:
    """Raises GeometryError also where the part reaches over the edge of the grid."""
    bodies = (placement or Placement()).placed(read_bodies(path, unit), nx, ny, pitch)
    low, high = bounds(bodies)
    errors = [
        f"reaches from {name} = {low[axis] * MM_PER_M:.6g} mm to {high[axis] * MM_PER_M:.6g} mm; "
        f"the cells lie between {-pitch / 2 * MM_PER_M:.6g} mm and {(count - 0.5) * pitch * MM_PER_M:.6g} mm"
        for axis, (name, count) in enumerate((("x", nx), ("y", ny)))
        if low[axis] < -pitch / 2 or high[axis] > (count - 0.5) * pitch
    ]
    if reason := memory_error(nx * ny * 16 + 2 * sum(body.triangles.nbytes for body in bodies)):
        errors.append(f"on {nx} x {ny} cells: {reason}")
    if errors:
        raise GeometryError(f"{path}: " + "; ".join(errors))
    return bodies


def closed_columns(
    source: str, bodies: Sequence[Body], nx: int, ny: int, pitch: float, open_columns: OpenColumns
) -> MeshColumns:
    """Columns of bodies, without what is cut away. Raises GeometryError for bodies that are open or inside out."""
    parts: list[MeshColumns] = []

    def closed(some: Sequence[Body], what: str) -> Columns:
        parts.append(_closed(source + what, some, nx, ny, pitch, open_columns))
        return parts[-1].columns

    columns = left_by_cuts(bodies, closed)
    if columns.tops.size == 0:
        low, high = bounds(bodies)
        what = "what negative volumes leave of the part" if len(parts) > 1 else "the part"
        size = " x ".join(f"{MM_PER_M * side:.4g}" for side in high - low)
        room = " x ".join(f"{MM_PER_M * count * pitch:.4g}" for count in (nx, ny))
        raise GeometryError(
            f"{source}: no centre of a cell lies in {what}, which is {size} mm; the grid is {room} mm, a cell "
            f"{pitch * MM_PER_M:.4g} mm; needs another unit, another place or a finer pitch"
        )
    return replace(parts[0], columns=columns, open_cells=np.concatenate([part.open_cells for part in parts]))


def _closed(source: str, bodies: Sequence[Body], nx: int, ny: int, pitch: float, mode: OpenColumns) -> MeshColumns:
    """Columns of bodies as they are, without regard to what is cut away."""
    found = mesh_columns(bodies, nx, ny, pitch)
    limit = OPEN_MAX * found.occupied
    if found.inside_out > limit:
        raise GeometryError(f"{source}: {_inside_out(found, ny, pitch)}")
    if found.open_cells.size == 0:
        return found
    if mode == "neighbours" and found.open_cells.size <= limit:
        return replace(found, columns=_filled_by_neighbours(found.columns, found.open_cells))
    remedy = f'mend the mesh, or set open_columns = "neighbours", which takes up to {OPEN_MAX:.1%}'
    if found.open_cells.size > limit:
        remedy = f'mend the mesh; open_columns = "neighbours" takes at most {OPEN_MAX:.1%}'
    raise GeometryError(
        f"{source}: {_share(found.open_cells.size, found.occupied)} are open: a line upwards enters the surface and "
        f"does not leave it, or the other way round; the first at {_places(found.open_cells, ny, pitch)}; {remedy}"
    )


def _inside_out(found: MeshColumns, ny: int, pitch: float) -> str:
    place = _places(np.array([found.inside_out_cell]), ny, pitch)
    columns = f"{_share(found.inside_out, found.occupied)} are inside out, the first at {place}"
    if found.open_cells.size == 0:
        return f"{columns}: faces point into the body; turn them round (flip normals)"
    return (
        f"{columns}, and {found.open_cells.size:,} are open, the first at {_places(found.open_cells, ny, pitch)}: some "
        "faces point into the body, or are missing; make the normals consistent, and close the holes"
    )


def _share(count: int, occupied: int) -> str:
    share = 100.0 * count / occupied
    return (
        f"{count:,} of {occupied:,} columns ({share if share < 99.5 else round(share):.{2 if share < 99.5 else 3}g}%)"
    )


def _places(cells: NDArray[np.int64], ny: int, pitch: float) -> str:
    x, y = (index[:_SHOWN] * pitch * MM_PER_M for index in np.divmod(cells, ny))
    return ", ".join(f"({at_x:.6g}, {at_y:.6g}) mm" for at_x, at_y in zip(x, y, strict=True))


def _filled_by_neighbours(columns: Columns, open_cells: NDArray[np.int64]) -> Columns:
    """Every open cell gets the column of the neighbour with the median filled height, from the rim of a hole inwards.

    open_cells: i ny + j; at least one cell must be closed. Of two neighbours in the middle the lower one counts.
    """
    cells = columns.nx * columns.ny
    source = np.arange(cells)
    source[open_cells] = -1
    filled = np.concatenate([[0.0], np.cumsum(columns.tops - columns.bottoms)])
    filled = np.diff(filled[columns.offsets])
    left = open_cells
    while left.size:
        around = _neighbours(left, columns.nx, columns.ny)
        known = np.where(around >= 0, source[around], -1)
        height = np.where(known >= 0, filled[known], np.inf)
        order = np.argsort(height, axis=0, kind="stable")
        count = (known >= 0).sum(axis=0)
        middle = np.take_along_axis(order, np.maximum(count - 1, 0)[None] // 2, axis=0)
        source[left] = np.take_along_axis(known, middle, axis=0)[0]
        left = left[count == 0]
    return _rearranged(columns, source)


def _neighbours(cell: NDArray[np.int64], nx: int, ny: int) -> NDArray[np.int64]:
    """The four neighbours of each cell, (4, cells), -1 beyond the edge."""
    i, j = np.divmod(cell, ny)
    at = [(i + di, j + dj) for di, dj in _SIDES]
    return np.stack([np.where((k >= 0) & (k < nx) & (m >= 0) & (m < ny), k * ny + m, -1) for k, m in at])


def _rearranged(columns: Columns, source: NDArray[np.int64]) -> Columns:
    """Cell c gets the column of cell source[c]."""
    counts = np.diff(columns.offsets)[source]
    offsets = np.concatenate([[0], np.cumsum(counts)])
    take = np.repeat(columns.offsets[source] - offsets[:-1], counts) + np.arange(offsets[-1])
    return Columns(columns.nx, columns.ny, columns.pitch, offsets, columns.bottoms[take], columns.tops[take])

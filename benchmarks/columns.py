"""Meshes to columns and membership of measured heights, compared with trimesh and embreex where they are installed."""

from __future__ import annotations

import importlib.util
import tempfile
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.text import Text

from benchmarks.timing import least, scaled, table_of
from inkloop.geometry import Columns, load
from inkloop.geometry.body import Body
from inkloop.geometry.mesh_columns import mesh_columns
from inkloop.units import GIGA, MM_PER_M
from support import meshes
from support.meshes import Triangles
from support.peak_memory import of_this_process

ROUNDS = 3
SAMPLED = 200
"""Cells along each side that trimesh is asked for; its time is that of as many cells as the columns have."""
HEADINGS = (
    *("mesh", "triangles", "grid", "read to columns", "of it columns", "intervals", "open columns"),
    *("volume / exact - 1", "membership of a cell", "trimesh + embreex / columns"),
)
EDGE = 10e-3
"""Of the grid [m]; the meshes have an edge of 8 mm."""


def measure() -> Group:
    """Processor time, the least of some rounds."""
    table = table_of("mesh to columns, processor time", HEADINGS)
    has_embree = importlib.util.find_spec("embreex") is not None
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        torus, volume = _meshes()["torus"]
        (folder / "torus.stl").write_bytes(meshes.binary_stl(torus * MM_PER_M))
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
            peak = process.submit(_peak, folder / "torus.stl", 6000).result()
        for name, (triangles, exact) in _meshes().items():
            (folder / f"{name}.stl").write_bytes(meshes.binary_stl(triangles * MM_PER_M))
            table.add_row(name, *_row(folder / f"{name}.stl", triangles, exact, 1575, has_embree))
        table.add_row("torus", *_row(folder / "torus.stl", torus, volume, 6000, False))
    notes = [f"memory of a process that reads the torus and fills 6000 x 6000 columns: {peak:.2f} GB at most"]
    if not has_embree:
        notes.append("embreex is not installed, so nothing is compared: pip install embreex")
    return Group(table, *(Text(note) for note in notes))


def _meshes() -> dict[str, tuple[Triangles, float]]:
    """Triangles about the origin [m], and the volume that they enclose [m3]."""
    torus, gyroid = meshes.torus(708, 354, 2.9e-3, 1.1e-3), 8e-3 * (meshes.gyroid(66, 2.5, 0.4) - 0.5)
    r, d = 3e-3, 2e-3
    balls = [meshes.ball(572, r) + np.array([at, 0.0, 0.0]) for at in (-d / 2, d / 2)]
    lens = np.pi * (4 * r + d) * (2 * r - d) ** 2 / 12
    return {
        "torus": (torus, meshes.volume(torus)),
        "gyroid": (gyroid, meshes.volume(gyroid)),
        "two balls that overlap": (np.concatenate(balls), 8 / 3 * np.pi * r**3 - lens),
    }


def _row(path: Path, triangles: Triangles, volume: float, cells: int, compare: bool) -> list[str]:
    pitch = EDGE / cells
    reading = least(lambda: load(path, cells, cells, pitch, unit="mm"), ROUNDS)
    bodies = [Body(triangles + np.array([EDGE / 2, EDGE / 2, 0.0]))]
    filling = least(lambda: mesh_columns(bodies, cells, cells, pitch), ROUNDS)
    found = mesh_columns(bodies, cells, cells, pitch)
    low, high = triangles[..., 2].min(), triangles[..., 2].max()
    z = np.random.default_rng(1).uniform(low, high, (cells, cells))
    asking = least(lambda: found.columns.inside(z), ROUNDS)
    return [
        *(
            f"{len(triangles):,}",
            f"{cells} x {cells}",
            scaled(reading),
            scaled(filling),
            f"{found.columns.tops.size:,}",
        ),
        *(f"{found.open_cells.size:,}", f"{found.columns.volume / volume - 1.0:+.1e}", scaled(asking / cells**2)),
        f"{_trimesh(bodies[0].triangles, found.columns, z) / (filling + asking):.0f}" if compare else "",
    ]


def _trimesh(triangles: Triangles, columns: Columns, z: np.ndarray) -> float:
    """Seconds that trimesh takes to decide for every cell whether it contains a height, by a share of the cells."""
    import trimesh
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    cells = z.shape[0]
    faces = np.arange(3 * len(triangles)).reshape(-1, 3)
    mesh = trimesh.Trimesh(MM_PER_M * triangles.reshape(-1, 3), faces, process=False)
    at = np.linspace(0, cells - 1, SAMPLED).astype(np.int64)
    i, j = (index.ravel() for index in np.meshgrid(at, at, indexing="ij"))
    points = MM_PER_M * np.stack([i * columns.pitch, j * columns.pitch, z[i, j]], axis=-1)
    ray = RayMeshIntersector(mesh)
    ray.contains_points(points[:1])  # builds its tree
    return least(lambda: ray.contains_points(points), ROUNDS) * cells**2 / len(points)


def _peak(path: Path, cells: int) -> float:
    """Most memory that this process held while it read a mesh to columns [GB]."""
    load(path, cells, cells, EDGE / cells, unit="mm")
    return of_this_process() / GIGA

"""Closed meshes whose volume is known, as triangles (n, 3, 3), counterclockwise from outside."""

from __future__ import annotations

from itertools import permutations
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Triangles = NDArray[np.float64]
Point: TypeAlias = tuple[float, ...]


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> Triangles:
    """Twelve triangles."""
    corners = np.array(list(np.ndindex(2, 2, 2)))
    points = np.where(corners == 0, low, high).astype(np.float64)
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    return points[np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])]


def wrapped(points: NDArray[np.float64]) -> Triangles:
    """Triangles of points (n, m, 3) on a surface that closes in both directions."""
    a, b = points, np.roll(points, -1, axis=0)
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return np.concatenate([np.stack([a, b, c], 2).reshape(-1, 3, 3), np.stack([a, c, d], 2).reshape(-1, 3, 3)])


def torus(n: int, m: int, radius: float, tube: float) -> Triangles:
    """2 n m triangles about the origin, its axis along z."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.arange(m) * 2 * np.pi / m, indexing="ij")
    out = radius + tube * np.cos(v)
    return wrapped(np.stack([out * np.cos(u), out * np.sin(u), tube * np.sin(v)], axis=-1))


def ball(n: int, radius: float) -> Triangles:
    """n meridians, n / 2 zones, its corners on the sphere about the origin."""
    u, v = np.meshgrid(np.arange(n) * 2 * np.pi / n, np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1), indexing="ij")
    points = radius * np.stack([np.cos(v) * np.cos(u), np.cos(v) * np.sin(u), np.sin(v)], axis=-1)
    points[:, 0], points[:, -1] = (0.0, 0.0, -radius), (0.0, 0.0, radius)
    triangles = wrapped(points)
    corners = np.ones_like(triangles[:, 0, 0], dtype=np.bool_)
    for one, other in ((0, 1), (1, 2), (2, 0)):  # no edge between two copies of a pole
        corners &= (triangles[:, one] != triangles[:, other]).any(axis=1)
    return triangles[corners]


def isosurface(field: NDArray[np.float64], spacing: float) -> Triangles:
    """Surface of field < 0 by marching tetrahedra, six in each cube of samples; closed where the rim is above 0."""
    index = np.arange(field.size).reshape(field.shape)
    values, points = field.ravel(), spacing * np.stack(np.unravel_index(index.ravel(), field.shape), axis=-1)
    shape = [size - 1 for size in field.shape]

    def cut(inside: NDArray[np.int64], outside: NDArray[np.int64]) -> NDArray[np.float64]:
        share = values[inside] / (values[inside] - values[outside])
        return points[inside] + share[:, None] * (points[outside] - points[inside])

    found = []
    for axes in permutations(range(3)):
        steps = np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(axes)]], axis=0)
        tetrahedra = np.stack([index[tuple(map(slice, s, s + shape))].ravel() for s in steps], axis=-1)
        is_in = values[tetrahedra] < 0.0
        code = is_in @ [1, 2, 4, 8]
        for case in range(1, 15):
            corners = tetrahedra[code == case]
            own = [n for n in range(4) if case >> n & 1]
            others = [n for n in range(4) if not case >> n & 1]
            odd = (_parity(axes) + _parity((*own, *others))) % 2
            a, b = [corners[:, n] for n in own], [corners[:, n] for n in others]
            if len(own) == 1:
                faces = [[cut(a[0], each) for each in b]]
            elif len(own) == 3:
                faces = [[cut(each, b[0]) for each in a]]
            else:
                ring = [cut(a[0], b[0]), cut(a[0], b[1]), cut(a[1], b[1]), cut(a[1], b[0])]
                faces = [[ring[0], ring[1], ring[2]], [ring[0], ring[2], ring[3]]]
            found += [np.stack(face[::-1] if odd else face, axis=1) for face in faces]
    return np.concatenate(found)


def _parity(order: tuple[int, ...]) -> int:
    return sum(order[n] > order[m] for m in range(len(order)) for n in range(m)) % 2


def gyroid(samples: int, periods: float, wall: float) -> Triangles:
    """Two sheets of a gyroid of `periods` in a unit cube, |sin x cos y + ...| < wall, closed by the cube."""
    at = np.linspace(-0.02, 1.02, samples)
    x, y, z = (2 * np.pi * periods * axis for axis in np.meshgrid(at, at, at, indexing="ij"))
    sheet = np.abs(np.sin(x) * np.cos(y) + np.sin(y) * np.cos(z) + np.sin(z) * np.cos(x)) - wall
    cube = np.max([np.abs(axis - 0.5) - 0.5 for axis in np.meshgrid(at, at, at, indexing="ij")], axis=0)
    return isosurface(np.maximum(sheet, cube * 20.0), 1.04 / (samples - 1))


def hull(points: NDArray[np.float64]) -> Triangles:
    """Faces of the convex hull."""
    triangles = points[ConvexHull(points, qhull_options="QJ").simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inwards = np.einsum("ij,ij->i", normals, triangles[:, 0] - points.mean(axis=0)) < 0.0
    triangles[inwards] = triangles[inwards, ::-1]
    return triangles


def halves(convex: Triangles, normal: NDArray[np.float64], offset: float) -> tuple[Triangles, Triangles]:
    """A convex body cut by the plane normal . x = offset, above and below; one fan of triangles closes both."""
    above: list[list[Point]] = []
    below: list[list[Point]] = []
    rim: dict[Point, Point] = {}

    def cut(a: Point, b: Point) -> Point:
        low, high = (np.array(end) for end in sorted((a, b)))  # the same bits for both triangles at the edge
        return tuple((low + (offset - normal @ low) / (normal @ (high - low)) * (high - low)).tolist())

    for triangle in convex:
        corners: list[Point] = [tuple(corner) for corner in triangle.tolist()]
        is_above = [bool(normal @ corner >= offset) for corner in triangle]
        polygons: dict[bool, list[Point]] = {True: [], False: []}
        crossed: dict[bool, Point] = {}
        for n, after in ((0, 1), (1, 2), (2, 0)):
            polygons[is_above[n]].append(corners[n])
            if is_above[n] != is_above[after]:
                crossed[is_above[n]] = point = cut(corners[n], corners[after])
                polygons[True].append(point)
                polygons[False].append(point)
        if crossed:  # the upper polygon goes from where it leaves to where it enters; its lid the other way round
            rim[crossed[False]] = crossed[True]
        above += _fan(polygons[True])
        below += _fan(polygons[False])
    ring = [next(iter(rim))] if rim else []
    while rim and rim[ring[-1]] != ring[0]:
        ring.append(rim[ring[-1]])
    lid = _fan(ring)
    return np.array(above + lid), np.array(below + [face[::-1] for face in lid])


def _fan(polygon: list[Point]) -> list[list[Point]]:
    return [[polygon[0], *polygon[n : n + 2]] for n in range(1, len(polygon) - 1)]


def volume(triangles: Triangles) -> float:
    """Divergence theorem, about the origin."""
    return float(np.einsum("ij,ij->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))) / 6.0


def turned(triangles: Triangles, rng: np.random.Generator) -> Triangles:
    """By a random rotation about the origin; equal corners stay equal."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.linalg.det(q))
    x, y, z = np.moveaxis(triangles, -1, 0)
    return np.stack([row[0] * x + row[1] * y + row[2] * z for row in q], axis=-1)


def binary_stl(triangles: Triangles, header: bytes = b"") -> bytes:
    """A binary STL file."""
    records = np.zeros(len(triangles), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("unused", "<u2")])
    records["corners"] = triangles
    return header.ljust(80, b" ") + np.uint32(len(triangles)).tobytes() + records.tobytes()


def ascii_stl(triangles: Triangles) -> bytes:
    """An ASCII STL file."""
    lines = ["solid part"]
    for triangle in triangles.tolist():
        corners = [f"vertex {x!r} {y!r} {z!r}" for x, y, z in triangle]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    return "\n".join([*lines, "endsolid part", ""]).encode()


def ply(triangles: Triangles) -> bytes:
    """An ASCII PLY file in which triangles share no corners."""
    points = triangles.reshape(-1, 3).tolist()
    faces = [f"3 {n} {n + 1} {n + 2}" for n in range(0, len(points), 3)]
    header = ["ply", "format ascii 1.0", f"element vertex {len(points)}", *(f"property double {a}" for a in "xyz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    return "\n".join([*header, *(f"{x!r} {y!r} {z!r}" for x, y, z in points), *faces, ""]).encode()


def binary_ply(triangles: Triangles) -> bytes:
    """A binary PLY file in which triangles share no corners."""
    faces = np.zeros(len(triangles), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, np.arange(3 * len(triangles)).reshape(-1, 3)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {3 * len(triangles)}"]
    header += [*(f"property double {a}" for a in "xyz"), f"element face {len(triangles)}"]
    header += ["property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(header).encode() + triangles.astype("<f8").tobytes() + faces.tobytes()


def obj(triangles: Triangles) -> bytes:
    """An OBJ file in which triangles share no corners."""
    points = triangles.reshape(-1, 3).tolist()
    faces = [f"f {n} {n + 1} {n + 2}" for n in range(1, len(points) + 1, 3)]
    return "\n".join([*(f"v {x!r} {y!r} {z!r}" for x, y, z in points), *faces, ""]).encode()

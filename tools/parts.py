"""Write the files of the parts in scenarios/parts: python -m tools.parts."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

FOLDER = Path(__file__).parents[1] / "scenarios" / "parts"
HOLE_CORNERS, PIPE_CORNERS = 48, 64
PIPES = (2.63256, 0.18), (1.711164, 0.117)
"""Half-axes of the pipes in scenarios/pipe-junction.toml, half of them across."""
ARCHIVE_DATE = (1980, 1, 1, 0, 0, 0)  # the earliest of a zip: the same part gives the same bytes
Triangles: TypeAlias = NDArray[np.float64]
"""(n, 3 corners, x y z) [mm], counterclockwise from outside."""
Outline: TypeAlias = Sequence[tuple[float, float]]


def prism(outline: Outline, bottom: float, top: float) -> Triangles:
    """An upright body over a convex outline, which goes counterclockwise."""
    corners = np.array(outline, np.float64)
    following = np.roll(corners, -1, axis=0)
    fan = np.stack([np.broadcast_to(corners[0], corners[1:-1].shape), corners[1:-1], corners[2:]], axis=1)
    return np.concatenate([_at(fan, top), _at(fan[:, ::-1], bottom), _walls(corners, following, bottom, top)])


def box(x: tuple[float, float], y: tuple[float, float], bottom: float, top: float) -> Triangles:
    """A cuboid between two corners."""
    return prism([(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])], bottom, top)


def drilled(center: tuple[float, float], half: float, radius: float, bottom: float, top: float) -> Triangles:
    """A square plate with a hole through its middle; half: of its edge."""
    angle = (np.arange(HOLE_CORNERS) + 0.5) / HOLE_CORNERS * 2 * np.pi
    ray = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    inner = center + radius * ray
    outer = center + half * ray / np.abs(ray).max(axis=1, keepdims=True)
    corners = [_corner(outer[k - 1], outer[k], center) for k in range(HOLE_CORNERS)]
    faces = []
    walls = [_walls(np.roll(inner, -1, axis=0), inner, bottom, top)]
    for k in range(HOLE_CORNERS):
        ring = [outer[k - 1], *corners[k], outer[k]]
        faces += [(inner[k - 1], ring[n], ring[n + 1]) for n in range(len(ring) - 1)]
        faces.append((inner[k - 1], outer[k], inner[k]))
        walls.append(_walls(np.array(ring[:-1]), np.array(ring[1:]), bottom, top))
    flat = np.array(faces)
    return np.concatenate([_at(flat, top), _at(flat[:, ::-1], bottom), *walls])


def bracket() -> Triangles:
    """An L of two arms with a hole in each, and a rib along its outer edges; bodies that touch and overlap."""
    plate, rib = 0.114, 0.228
    return np.concatenate(
        [
            drilled((0.6, 2.4), 0.6, 0.32, 0.0, plate),
            drilled((3.4, 0.6), 0.6, 0.32, 0.0, plate),
            box((0.0, 1.2), (0.0, 1.8), 0.0, plate),
            box((1.2, 2.8), (0.0, 1.2), 0.0, plate),
            box((0.0, 4.0), (0.0, 0.2), 0.0, rib),
            box((0.0, 0.2), (0.0, 3.0), 0.0, rib),
        ]
    )


def logo() -> Mapping[str, list[Triangles]]:
    """A plate with the word "ink" through it, by material; the letters are cut out of the plate by its ink alone."""
    height = 0.076
    letters = [
        box((0.4, 0.8), (0.4, 1.6), 0.0, height),
        box((0.4, 0.8), (1.9, 2.3), 0.0, height),
        box((1.2, 1.6), (0.4, 1.6), 0.0, height),
        box((2.1, 2.5), (0.4, 1.4), 0.0, height),
        box((1.6, 2.3), (1.2, 1.6), 0.0, height),
        box((2.9, 3.3), (0.4, 2.3), 0.0, height),
        prism([(3.3, 0.8), (3.3, 1.2), (3.85, 1.6), (4.4, 1.6)][::-1], 0.0, height),
        prism([(3.6, 1.05), (4.4, 0.4), (3.9, 0.4), (3.3, 0.9)][::-1], 0.0, height),
    ]
    return {"letters": letters, "plate": [box((0.0, 4.8), (0.0, 2.7), 0.0, height)]}


def pipe_junction(
    outer: tuple[float, float], inner: tuple[float, float], width: float, height: float
) -> Mapping[str, list[Triangles]]:
    """Two elliptic pipes that cross in the middle of a block, by material, about the z axis; the bores are open.

    outer, inner: half-axes across and upright; width: edge of the block, which holds the walls and their surroundings.
    """
    arm = _arm(_ellipse(*outer), _ellipse(*inner), width / 2)
    x, y, z = np.moveaxis(arm, -1, 0)
    turned = [np.stack([*plane, z + height / 2], axis=-1) for plane in ((x, y), (-y, x), (-x, -y), (y, -x))]
    block = box((-width / 2, width / 2), (-width / 2, width / 2), 0.0, height)
    return {"walls": [np.concatenate(turned)], "support": [block]}


def lithophane() -> NDArray[np.uint8]:
    """A moon over water in grey values, the first row at the top: thick where light shall not pass."""
    rows, columns = 40, 48
    y, x = np.mgrid[0:rows, 0:columns]
    moon = np.hypot(x - 31.0, y - 11.0)
    craters = 50.0 * (np.hypot(x - 28.0, y - 9.0) < 2.4) + 40.0 * (np.hypot(x - 33.5, y - 14.0) < 1.8)
    sky = 160.0 - y - 45.0 * np.exp(-np.maximum(moon - 7.6, 0.0) / 5.0)
    water = 190.0 + 30.0 * np.sin(1.3 * (y - 25)) - 100.0 * np.exp(-(((x - 31.0) / 4.5) ** 2))
    picture = np.where(y >= 25, water, np.where(moon < 7.6, 25.0 + craters, sky))
    hill = (y < 25) & (y > 23.0 - 7.0 * np.exp(-(((x - 8.0) / 7.0) ** 2)))
    return np.where(hill, 235.0, picture).clip(0.0, 255.0).astype(np.uint8)


def stl(triangles: Triangles) -> bytes:
    """Binary STL."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    record = np.zeros(len(triangles), [("facets", "<f4", (4, 3)), ("attribute", "<u2")])
    record["facets"] = np.concatenate([normal[:, None], triangles], axis=1)
    return b"inkloop".ljust(80, b" ") + struct.pack("<I", len(triangles)) + record.tobytes()


def three_mf(parts: Mapping[str, list[Triangles]]) -> list[tuple[str, str]]:
    """The members of a 3MF package: one object of each part, a base material of its own with the same name."""
    names = list(parts)
    materials = "".join(f'<base name="{name}" displaycolor="#808080"/>' for name in names)
    objects = [_object(number, name, np.concatenate(parts[name])) for number, name in enumerate(names)]
    items = "".join(f'<item objectid="{number + 2}"/>' for number in range(len(names)))
    model = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<model unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02">\n'
        f'<resources><basematerials id="1">{materials}</basematerials>\n{"".join(objects)}</resources>\n'
        f"<build>{items}</build></model>\n"
    )
    package = "http://schemas.openxmlformats.org/package/2006"
    types = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<Types xmlns="{package}/content-types">'
        f'<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/></Types>\n'
    )
    relations = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<Relationships xmlns="{package}/relationships">'
        '<Relationship Id="model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" '
        'Target="/3D/part.model"/></Relationships>\n'
    )
    return [("[Content_Types].xml", types), ("_rels/.rels", relations), ("3D/part.model", model)]


def write_three_mf(path: Path, parts: Mapping[str, list[Triangles]]) -> None:
    """Write a 3MF file, stored without compression."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in three_mf(parts):
            archive.writestr(zipfile.ZipInfo(name, ARCHIVE_DATE), text)


FILES: Mapping[str, Callable[[Path], object]] = {
    "bracket.stl": lambda path: path.write_bytes(stl(bracket())),
    "lithophane.png": lambda path: Image.fromarray(lithophane()).save(path),
    "pipe-junction.3mf": lambda path: write_three_mf(path, pipe_junction(*PIPES, 12.109776, 0.4)),
    "two-inks.3mf": lambda path: write_three_mf(path, logo()),
}
"""File name -> what writes it."""


def main() -> None:
    """Write all files."""
    FOLDER.mkdir(exist_ok=True)
    for name, write in FILES.items():
        write(FOLDER / name)


def _at(flat: NDArray[np.float64], height: float) -> Triangles:
    """Triangles of the plane at a height."""
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), height)], axis=2)


def _walls(begin: NDArray[np.float64], end: NDArray[np.float64], bottom: float, top: float) -> Triangles:
    """Upright walls from each begin to its end, with the outside on their right."""
    low, high = ([np.column_stack([points, np.full(len(points), z)]) for points in (begin, end)] for z in (bottom, top))
    return np.concatenate([np.stack([low[0], low[1], high[1]], axis=1), np.stack([low[0], high[1], high[0]], axis=1)])


def _corner(
    first: NDArray[np.float64], second: NDArray[np.float64], center: tuple[float, float]
) -> list[NDArray[np.float64]]:
    """The corner of a square between two points of its edge, if there is one."""
    if np.isclose(first, second, rtol=0.0, atol=1e-12).any():
        return []
    return [np.where(np.abs(first - center) > np.abs(second - center), first, second)]


def _ellipse(across: float, upright: float) -> NDArray[np.float64]:
    """Corners of an outline (corners, 2), counterclockwise; mirrored ones are equal to the last bit."""
    angle = np.arange(PIPE_CORNERS) / PIPE_CORNERS * 2 * np.pi
    return np.round(np.stack([np.cos(angle), np.sin(angle)], axis=1), 12) * (across, upright)


def _arm(outer: NDArray[np.float64], inner: NDArray[np.float64], end: float) -> Triangles:
    """A quarter of a junction: the pipe along x from its mitres, |y| = x, to its end, with the outlines (y, z)."""
    near = [np.column_stack([np.abs(outline[:, 0]), outline]) for outline in (outer, inner)]
    far = [np.column_stack([np.full(len(outline), end), outline]) for outline in (outer, inner)]
    return np.concatenate([_band(near[0], far[0]), _band(far[1], near[1]), _band(far[0], far[1])])


def _band(one: NDArray[np.float64], other: NDArray[np.float64]) -> Triangles:
    """Between two closed lines of as many corners, which go counterclockwise seen from the second one."""
    next_one, next_other = (np.roll(line, -1, axis=0) for line in (one, other))
    return np.concatenate([np.stack([one, next_one, next_other], axis=1), np.stack([one, next_other, other], axis=1)])


def _object(number: int, name: str, triangles: Triangles) -> str:
    corners, index = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    vertices = "".join(f'<vertex x="{x:g}" y="{y:g}" z="{z:g}"/>' for x, y, z in corners)
    faces = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in index.reshape(-1, 3))
    return (
        f'<object id="{number + 2}" name="{name}" pid="1" pindex="{number}" type="model">'
        f"<mesh><vertices>{vertices}</vertices><triangles>{faces}</triangles></mesh></object>\n"
    )


if __name__ == "__main__":
    main()

"""A grid for the part in a file: its pitch, its size, and the phase in which its cells are closest to the part."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any

from inkloop.component import Ink
from inkloop.errors import ScenarioError
from inkloop.geometry import overhangs
from inkloop.geometry.mesh_columns import SAMPLED_DIGITS, measured
from inkloop.limits import duration_text, memory_error, rounded_text, size_text
from inkloop.scenario.footprint import BYTES_OF_A_CELL, ROUNDING
from inkloop.scenario.part_file import ASSUMED_UNIT, NOWHERE, FileTable, PartFile, scaled, valid
from inkloop.scenario.validation import EMPTY_CELLS
from inkloop.tables.part_layers import Manifest
from inkloop.tables.part_mesh import MeshTable
from inkloop.tables.schema import ScenarioFile
from inkloop.tables.shapes import Bounds, Grid, PartError, Solid
from inkloop.units import MM_PER_M, UM_PER_M

PITCHES_UM = (Grid.model_fields["pitch_um"].default, 127.0, 84.667, 42.333, 21.167)
"""Pitches: that of Lu et al. 2015, then 200, 300, 600 and 1200 dots per inch."""
CELLS_MIN = 40
"""Cells along the longer side of a part that show its shape (assumed)."""
CLOSE = 1e-3
"""Share of the volume of a part within which no other phase of the grid is tried."""
MANY_LAYERS, FEW_LAYERS = 500, 100
"""Layers above which a smaller part is printed first, and layers of that part (assumed)."""
LARGE_CELLS = 6000 * 6000
"""Largest grid of which prints were measured; a larger one needs a given pitch."""
SECONDS_OF_A_CELL = 1e-6
"""Processor time of a cell (x86_64 near 2.5 GHz) until the part is described."""


@dataclass(frozen=True)
class FittedPart:
    """A part on a grid that was made for it. names: of objects and materials; hangs: whether it has overhangs.

    size_is_sampled: whether only SAMPLED_DIGITS of its width and depth are known.
    """

    table: FileTable
    grid: Grid
    solid: Solid
    size_um: tuple[float, float, float]
    names: tuple[str, ...]
    hangs: bool
    size_is_sampled: bool = False

    @property
    def size(self) -> str:
        """Its sides for a person."""
        sides = (rounded_text(side, SAMPLED_DIGITS) if self.size_is_sampled else f"{side:.6g}" for side in self.size_um)
        return f"{' x '.join(sides)} µm"

    @property
    def layers(self) -> int:
        """Full layers of the default ink in its height."""
        return math.ceil(self.solid.shape.height / _layer_height() - ROUNDING)

    @property
    def to_try(self) -> str | None:
        """A sentence on what to print first of a part of many layers."""
        if self.layers <= MANY_LAYERS:
            return None
        height = FEW_LAYERS * _layer_height() * UM_PER_M
        smaller = f"--height-um {height:g} makes it {FEW_LAYERS}, and " if isinstance(self.table, MeshTable) else ""
        return f"it is about {self.layers} layers high; to try it: {smaller}--set run.layers_max=20 prints the first 20"


def _layer_height() -> float:
    """Height of a full layer of the default ink [m]."""
    ink: Ink = ScenarioFile.model_fields["ink"].default.a.ink
    return ink.layer_height


def fit(file: PartFile, pitch_um: float | None, say: Callable[[str], None] = lambda sentence: None) -> FittedPart:
    """Lay a grid around a part, with empty cells at its edges, in the phase whose cells are closest to it in volume.

    say: gets a sentence before work that takes long. Raises ScenarioError.
    """
    try:
        table = file.table()
        contents: Any = table.read(Path())
        if isinstance(table, MeshTable):
            table = scaled(table, contents, file.height_um)
        box, names, is_sampled = _extent(table, contents)
        width, depth = (box.x_max - box.x_min) * UM_PER_M, (box.y_max - box.y_min) * UM_PER_M
        is_chosen = pitch_um is not None or isinstance(contents, Manifest)
        pitch_um = pitch_um or _pitch_um(contents, max(width, depth))
        valid(Grid, {"nx": 1, "ny": 1, "pitch_um": pitch_um})
        places = [
            _placed(table, box, pitch_um, phases)
            for phases in product(*(_phases(side / pitch_um) for side in (width, depth)))
        ]
        if work := _long_work(file, (width, depth), places[0][1], is_chosen):
            say(work)
            del places[1:]
        table, grid, solid = _closest(places, contents)
    except PartError as error:
        raise ScenarioError(str(file.path), error.errors) from error
    hangs = overhangs(solid.columns(grid.nx, grid.ny, grid.pitch)) is not None
    return FittedPart(table, grid, solid, (width, depth, solid.shape.height * UM_PER_M), names, hangs, is_sampled)


def _phases(width: float) -> list[tuple[int, float]]:
    """Cells along an axis for a part of `width`, and its shift from their middle, both in cells.

    In the middle a part gets a whole number of cells next to its width; at a quarter of a cell from it, walls inside of
    the part meet other centres. A cell next to EMPTY_CELLS is never reached.
    """
    most = math.ceil(width)
    counts = sorted({max(1, math.floor(width)), most}, key=lambda count: abs(count - width))
    empty = 2 * EMPTY_CELLS
    return [*((count + empty, 0.0) for count in counts), (most + empty, 0.25), (most + empty, -0.25)]


def _placed(
    table: FileTable, box: Bounds, pitch_um: float, phases: Sequence[tuple[int, float]]
) -> tuple[FileTable, Grid]:
    """The table and the grid in these phases along x and y; box: of the part as the table puts it around (0, 0)."""
    (nx, shift_x), (ny, shift_y) = phases
    grid = valid(Grid, {"nx": nx, "ny": ny, "pitch_um": pitch_um})
    moves = shift_x * grid.pitch - (box.x_min + box.x_max) / 2, shift_y * grid.pitch - (box.y_min + box.y_max) / 2
    centers = {
        f"center_{axis}_um": round((at + move) * UM_PER_M, 6)
        for axis, at, move in zip("xy", grid.middle, moves, strict=True)
        if abs(move) > ROUNDING * grid.pitch
    }
    return table.model_copy(update=centers), grid


def _closest(places: Sequence[tuple[FileTable, Grid]], contents: Any) -> tuple[FileTable, Grid, Solid]:
    """The place whose cells are closest in volume to the part. Raises PartError.

    Within CLOSE the first counts, of those without a remark, such as on walls on rows of centres, if there is any.
    """
    best, least = None, (math.inf, True)
    for table, grid in places:
        try:
            solid = table.solid(grid, Path(), contents)
        except PartError:
            if best is None:
                raise
            continue
        cells = solid.columns(grid.nx, grid.ny, grid.pitch).volume
        off = abs(cells / solid.volume - 1.0) if solid.volume else 0.0
        rank = max(CLOSE, round(off, 9)), bool(solid.remarks)
        if rank < least:
            best, least = (table, grid, solid), rank
        if rank == (CLOSE, False):
            break
    assert best is not None
    return best


def _long_work(file: PartFile, sides_um: tuple[float, float], grid: Grid, is_chosen: bool) -> str | None:
    """A sentence if a grid takes long. Raises PartError where it lacks memory, or a large one a given pitch."""
    cells = float(grid.nx) * grid.ny
    found = f"a grid of {grid.nx} x {grid.ny} cells of {grid.pitch_um:g} µm"
    unit = f" if its unit is {ASSUMED_UNIT}, which is assumed" if file.assumes_unit else ""
    sides = " x ".join(f"{side * MM_PER_M / UM_PER_M:g}" for side in sides_um)
    of_file = "--unit" if file.is_mesh else "--unit, --pixel-um"
    advice = f"the part is {sides} mm wide{unit}; correct {of_file}, or take a larger --pitch-um"
    if reason := memory_error(BYTES_OF_A_CELL * cells):
        raise PartError([f"file: {found} {reason}; {advice}"])
    if cells <= LARGE_CELLS:
        return None
    time, memory = duration_text(SECONDS_OF_A_CELL * cells), size_text(BYTES_OF_A_CELL * cells)
    work = f"{found} takes about {time} and {memory} of memory"
    if not is_chosen:
        raise PartError([f"file: {work}; {advice}, or give this one to go on"])
    return work


def _pitch_um(contents: Any, side: float) -> float:
    """That of the layers, else the first that shows a part of that longer side [um]."""
    if isinstance(contents, Manifest):
        return contents.pitch_x_um
    return next((pitch for pitch in PITCHES_UM if side >= CELLS_MIN * pitch), PITCHES_UM[-1])


def _extent(table: FileTable, contents: Any) -> tuple[Bounds, tuple[str, ...], bool]:
    """The box of a part as the table puts it around (0, 0), and the names in its file. Raises PartError.

    The last value: whether the box is sampled.
    """
    if isinstance(table, MeshTable):
        (x_min, y_min, _), (x_max, y_max, _), _, is_sampled, _ = measured(table.placed(contents, NOWHERE))
        box = Bounds(float(x_min), float(x_max), float(y_min), float(y_max))
        return box, tuple(dict.fromkeys(body.name or body.material for body in contents)), is_sampled
    box = table.solid(NOWHERE, Path(), contents).bounds
    if box.x_min == box.x_max:
        raise PartError(["file: has nothing above 0, and so nothing to print; check the file"])
    return box, (), False

"""Resources of a print: memory, disk and processor time, estimated before anything of its size is allocated.

The figures are measured on prints of parts with rough droplets and noisy scans into a folder. Disk: ten layers of
6000 x 6000 cells planned one ahead; memory: the slope between grids of 900 x 900 and 1300 x 1300, which does not grow
with layers, since these are on disk. Classes and FMUs of others are not included. Computing is processor time on one
core of x86_64 near 2.5 GHz, of the whole command, constants by layers ahead: of the print of 6000 x 6000 and of ten
layers of 400 x 400; on grids of up to SMALL_CELLS that of the shipped scenarios, most of it start and pictures.

The layers of a closed loop are those that raise the edge of the part, whose cells lack neighbours on one side, by
droplets of the mean volume; then its top is made flat, in about as many layers as are planned ahead. Of the shipped
scenarios this is within a quarter of what is printed, but for VolumeAreaDeposition (12 expected, 17 printed) and
two-materials, a small part of two inks (32 expected, 63 printed).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from inkloop.errors import ResultError
from inkloop.limits import KIB, ROUNDED_CELLS, available_memory, duration_text, free_disk, memory_error, size_text
from inkloop.tables.schema import ComponentTable, ScenarioFile

BYTES_OF_A_CELL = 285
BYTES_OF_A_PLAN, BYTES_OF_A_LAYER_AHEAD = 60, 28
"""Additional memory of a cell if layers are planned: for the first, and for each further layer ahead."""
MORE_BYTES_OF_A_CELL: Mapping[str, int] = {"YoungLaplaceDeposition": 5700, "LayerController": 105}
"""Kind -> additional memory, if more than a hundred bytes per cell."""
STATE_BYTES: Mapping[str, int] = {"YoungLaplaceDeposition": 540, "LayerController": 70}
"""Kind -> bytes of its saved state in addition to STATE_BYTES_OF_A_CELL."""
STATE_BYTES_OF_A_CELL = 165
SECONDS_OF_A_COMMAND, SECONDS_OF_A_RUN, SECONDS_OF_A_SOLID_LAYER = 2.8, 0.5, 0.038
"""Processor time of start, table and pictures: of a command; more for each run, and for the solid of two inks."""
LAYERS_PLANNED = 20
"""Last layers of a part for which a plan is searched at most: the full layers before them need none."""
SECONDS_OF_A_CELL_AND_LAYER = 4e-6
"""Processor time of a printed cell and a full layer: model, sensor, record, and a controller that plans no layer."""
MORE_SECONDS: Mapping[int, float] = {1: 10e-6, 2: 10e-6, 3: 15e-6, 4: 35e-6, 5: 60e-6}
"""Layers ahead -> additional time of a layer for which a plan is searched."""
FOUR_PASSES = 5.0
"""Ratio of that time in layers of four passes."""
ANNEALED_VALUES, SECONDS_OF_ANNEALING = 1000, 0.08
"""Values of a plan of several layers up to which the search anneals too, and the time that this takes."""
SMALL_CELLS = 20_000
LARGE_SECONDS_OF_A_CELL_AND_LAYER = 1.25e-6
LARGE_MORE_SECONDS: Mapping[int, float] = {1: 0.4e-6, 2: 1.5e-6, 3: 5e-6, 4: 17e-6, 5: 60e-6}
"""The same two on larger grids, where single layers are not annealed and overhead per layer is negligible."""
SECONDS_OF_A_MODEL: Mapping[str, float] = {"YoungLaplaceDeposition": 75e-6}
"""Kind -> additional time of a model."""
SECONDS_OF_A_LAYER_BY_LINEAR_PROGRAMS = 2300e-6
"""Additional time of a printed cell, a layer and a layer ahead with relaxation = "slp", in casadi.toml."""
PLANNING = ("LayerMpc", "LayerController")
HORIZONS: Mapping[str, int] = {"even": 5, "fast": 4}
"""`finish` of these controllers -> layers ahead, where `horizon` is not given."""
CLOSING_LAYERS = 5
"""Layers that make the top flat, of a controller that does not name its layers ahead."""
ROUNDING = 1e-6
"""Share of a layer that single precision of files may add to a height."""
LAYER_BYTES, RESULT_BYTES, ROUNDED_RESULT_BYTES = 34, 21, 9
"""Bytes of a cell and layer: in the layers kept while the print runs; in result.nc, with all digits or rounded."""
BYTES_OF_A_LAYER_FILE, BYTES_OF_A_STATE_FILE, BYTES_OF_A_RUN = 11 * KIB, 22 * KIB, 104 * KIB
"""Bytes of files whatever the cells, in blocks of 4 KiB: of a layer, of a state, and of a run with its result.nc."""
BYTES_OF_PICTURES, BYTES_OF_PICTURES_OF_A_RUN, BYTES_OF_A_SOLID = 300 * KIB, 150 * KIB, 300 * KIB
"""Of pictures as PNG: of each scenario, more for each run, and for the solid of two inks in each run."""
LEAST_CELLS = 64  # of a grid that is worth advising (assumed)
FAR_BEYOND = 10.0  # ratio of layers to those printed above which a height is in other units, or mistyped
HARDLY_A_LAYER = 0.3  # share of a layer's height: less than half of a droplet
CHECK_HEIGHT = "; check the heights of [part], and those of a droplet in [ink.a], which are in µm"


@dataclass(frozen=True)
class Footprint:
    """Cells, layers expected, and for each cell the bytes of memory and of disk, comparison runs included.

    nominal: height of the part in full layers; seconds: processor time of the command; disk_of_files: bytes whatever
    the cells, pictures included.
    """

    nx: int
    ny: int
    layers: int
    nominal: float
    memory_of_a_cell: int
    disk_of_a_cell: int
    seconds: float
    disk_of_files: int = 0

    @classmethod
    def of(cls, tables: ScenarioFile, height: float, printed: int = 0) -> Footprint:
        """The footprint of a scenario: of the run that takes most memory, and of the files and the time of all of them.

        height: of the part [m]; printed: cells of the part.
        """
        nominal = height / tables.ink.a.ink.layer_height
        runs = [tables.components, *(tables.components | other.components for other in tables.compare.values())]
        layers = [_layers(tables, run.values(), height) for run in runs]
        kinds = [{name: table.kind for name, table in run.items()} for run in runs]
        memory = [sum(map(_more_bytes, run.values())) for run in runs]
        is_small = tables.grid.nx * tables.grid.ny <= SMALL_CELLS
        base = SECONDS_OF_A_CELL_AND_LAYER if is_small else LARGE_SECONDS_OF_A_CELL_AND_LAYER
        slower = FOUR_PASSES if tables.process.passes > 1 else 1.0
        more = {n: slower * each for n, each in (MORE_SECONDS if is_small else LARGE_MORE_SECONDS).items()}
        seconds = sum(
            printed * count * base + sum(_seconds(table, count, printed, more) for table in run.values())
            for run, count in zip(runs, layers, strict=True)
        )
        pictures = SECONDS_OF_A_RUN * len(runs) + (SECONDS_OF_A_SOLID_LAYER * sum(layers) if tables.ink.b else 0.0)
        states = [sum(STATE_BYTES.get(kind, 0) for kind in run.values()) for run in kinds]
        return cls(
            tables.grid.nx,
            tables.grid.ny,
            layers[0],
            nominal,
            BYTES_OF_A_CELL + max(memory),
            _disk(tables, layers, STATE_BYTES_OF_A_CELL + max(states)),
            SECONDS_OF_A_COMMAND + pictures + seconds,
            _disk_of_files(tables, layers),
        )

    @property
    def memory(self) -> int:
        """Bytes of memory."""
        return self.memory_of_a_cell * self.nx * self.ny

    @property
    def disk(self) -> int:
        """Bytes of disk in the run folder at most: the saved state is there twice while it is replaced."""
        return self.disk_of_a_cell * self.nx * self.ny + self.disk_of_files

    @property
    def computing(self) -> str:
        """The time for a person."""
        return f"about {duration_text(float(f'{self.seconds:.2g}'))} of computing on one core"

    def __str__(self) -> str:
        """The resources as a sentence for a person."""
        memory, disk = size_text(self.memory), size_text(self.disk)
        return (
            f"about {_counted(self.layers)}, {memory} of memory beyond that of the program, {disk} of disk, "
            f"{self.computing}"
        )

    def warnings(self) -> Iterator[str]:
        """A sentence if the part has far more layers than are printed, or hardly one."""
        if self.nominal > FAR_BEYOND * self.layers:
            found = f"the part is about {self.nominal:,.0f} layers high"
            yield f"{found}; run.layers_max ends the print after {self.layers}{CHECK_HEIGHT}"
        if self.nominal < HARDLY_A_LAYER:
            found = f"the part is {self.nominal:.2g} of a layer high"
            yield f"{found}; a droplet is higher, and nothing may be printed{CHECK_HEIGHT}"

    def memory_errors(self) -> Iterator[str]:
        """The error of a grid too large for memory, with one that fits; a run that is resumed keeps its grid."""
        if reason := memory_error(self.memory):
            yield f"{self._grid()} {reason}; {self._advice((available_memory() or 0) / self.memory)} or free memory"

    def check_disk(self, folder: Path) -> None:
        """Raises ResultError if the disk of a run folder is too small for the run."""
        free = free_disk(folder)
        if free is not None and self.disk > free:
            found = f"needs about {size_text(self.disk)} of disk, {size_text(free)} are free there"
            share = max(0, free - self.disk_of_files) / (self.disk - self.disk_of_files)
            advice = f"{self._advice(share)} fewer layers, or another disk (--out)"
            raise ResultError(f"{folder}: {self._grid()} {found}; {advice}")

    def _grid(self) -> str:
        return f"grid of {self.nx} x {self.ny} cells, about {_counted(self.layers)},"

    def _advice(self, share: float) -> str:
        """A grid that would fit into this share of what all cells take, or that there is none; something may follow."""
        if share * self.nx * self.ny < LEAST_CELLS:
            return "there is no room for a smaller grid either: make room,"
        nx, ny = (math.floor(count * math.sqrt(share)) for count in (self.nx, self.ny))
        if min(nx, ny) < 1:  # one side is far too long: only that one is cut
            cells, short = share * self.nx * self.ny, min(self.nx, self.ny)
            nx, ny = (count if count == short else max(1, math.floor(cells / short)) for count in (self.nx, self.ny))
        return f"{nx} x {ny} cells would fit: choose a smaller grid or a larger pitch,"


def _disk(tables: ScenarioFile, layers: Sequence[int], state: int) -> int:
    """Bytes on disk for a cell at the peak: all layers of a run, the state twice or with the results, other results."""
    is_rounded = tables.grid.nx * tables.grid.ny > ROUNDED_CELLS
    results = [(ROUNDED_RESULT_BYTES if is_rounded else RESULT_BYTES) * (count + 1) for count in layers]
    largest = max(results)
    return LAYER_BYTES * (max(layers) + 1) + state + max(state, largest) + sum(results) - largest


def _disk_of_files(tables: ScenarioFile, layers: Sequence[int]) -> int:
    """Bytes on disk whatever the cells: of all runs, and of layers and two states, or of pictures, drawn after them."""
    of_a_run = BYTES_OF_PICTURES_OF_A_RUN + (BYTES_OF_A_SOLID if tables.ink.b else 0)
    printing = BYTES_OF_A_LAYER_FILE * (max(layers) + 1) + 2 * BYTES_OF_A_STATE_FILE
    return BYTES_OF_A_RUN * len(layers) + max(printing, BYTES_OF_PICTURES + of_a_run * len(layers))


def _more_bytes(table: ComponentTable) -> int:
    """Additional memory of a component for each cell."""
    more = MORE_BYTES_OF_A_CELL.get(table.kind, 0)
    if table.kind not in PLANNING:
        return more
    return more + BYTES_OF_A_PLAN + BYTES_OF_A_LAYER_AHEAD * ((_horizon(table) or 1) - 1)


def _seconds(table: ComponentTable, layers: int, printed: int, more: Mapping[int, float]) -> float:
    """Additional processor time of a component; printed: cells; more: of planning each of them, by layers ahead."""
    if table.kind not in PLANNING:
        return printed * layers * SECONDS_OF_A_MODEL.get(table.kind, 0.0)
    horizon, is_slp = _horizon(table) or 0, table.options.get("relaxation") == "slp"
    by_programs = SECONDS_OF_A_LAYER_BY_LINEAR_PROGRAMS * horizon if is_slp else 0.0
    annealing = SECONDS_OF_ANNEALING if horizon > 1 and 0 < horizon * printed <= ANNEALED_VALUES else 0.0
    return min(layers, LAYERS_PLANNED) * (annealing + printed * (more.get(horizon, 0.0) + by_programs))


def _horizon(table: ComponentTable) -> int | None:
    """Layers ahead of a controller that plans; None where its check reports another value."""
    horizon = table.options.get("horizon", HORIZONS.get(str(table.options.get("finish", "even"))))
    return horizon if isinstance(horizon, int) and horizon in MORE_SECONDS else None


def _layers(tables: ScenarioFile, run: Iterable[ComponentTable], height: float) -> int:
    """Layers of a run, at most those that it may have; an open loop prints those of the nominal height."""
    run, ink, most = list(run), tables.ink.a.ink, tables.run.layers_max
    nominal = height / ink.layer_height
    if (opened := next((table for table in run if table.kind == "OpenLoop"), None)) is not None:
        named = opened.options.get("layers")
        return max(1, math.ceil(min(named if isinstance(named, int) and named > 0 else nominal, most) - ROUNDING))
    if nominal <= 0.0:
        return 1
    edge = ink.h1 + 3.0 * ink.h2 + 2.0 * ink.h3
    volume = min(map(_mean_volume, run), default=1.0) * max((_drops(table) for table in run), default=1)
    closing = next((found for table in run if table.kind in PLANNING and (found := _horizon(table))), CLOSING_LAYERS)
    return min(most, math.ceil(min(height / (edge * volume), most) - ROUNDING) + closing)


def _mean_volume(table: ComponentTable) -> float:
    """Mean volume of the droplets of a printer, of the nominal one: up to these shares are missing, evenly."""
    shares = [table.options.get(key, 0.0) for key in ("variation", "nozzle_variation")]
    return math.prod(1.0 - 0.5 * share for share in shares if isinstance(share, int | float) and 0.0 <= share <= 1.0)


def _drops(table: ComponentTable) -> int:
    """Drops of which a grey head makes a droplet at most."""
    levels = table.options.get("drop_levels", 1)
    return levels if isinstance(levels, int) and levels > 0 else 1


def _counted(layers: int) -> str:
    return "1 layer" if layers == 1 else f"{layers} layers"

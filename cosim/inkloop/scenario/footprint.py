"""What a print takes of the machine: memory and disk, estimated from its tables before anything of its size exists.

The figures are measured: the peak of a process that prints a part with rough droplets and noisy scans into a folder,
from the slope between 300 x 300 and 600 x 600 cells; it does not grow with layers, which are on disk. What a class or
an FMU of others takes is not in them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from inkloop.errors import ResultError
from inkloop.limits import available_memory, free_disk, memory_error, size_text
from inkloop.tables.schema import ScenarioFile

BYTES_OF_A_CELL = 480
MORE_BYTES_OF_A_CELL: Mapping[str, int] = {"YoungLaplaceDeposition": 5700, "LayerController": 1000}
"""Kind -> memory in addition, more than a hundred bytes a cell."""
STATE_BYTES: Mapping[str, int] = {"YoungLaplaceDeposition": 540, "LayerController": 70}
"""Kind -> part of a saved state in addition to STATE_BYTES_OF_A_CELL."""
STATE_BYTES_OF_A_CELL = 155
ROUNDING = 1e-6
"""Share of a layer that files in single precision may add to a height."""
FILE_BYTES_OF_A_CELL_AND_LAYER = 50
"""29 in the layers kept while the print runs, 21 in result.nc."""


@dataclass(frozen=True)
class Footprint:
    """Cells, layers expected, and for each cell the bytes of memory and of disk, comparison runs included."""

    nx: int
    ny: int
    layers: int
    memory_of_a_cell: int
    disk_of_a_cell: int

    @classmethod
    def of(cls, tables: ScenarioFile, height: float) -> Footprint:
        """The footprint of a scenario: of the run that takes most memory, and of the files of all of them.

        height: of the part [m].
        """
        layers = _layers(tables, height)
        kinds = [{name: table.kind for name, table in tables.components.items()}]
        kinds += [
            kinds[0] | {name: table.kind for name, table in other.components.items()}
            for other in tables.compare.values()
        ]
        memory = [sum(MORE_BYTES_OF_A_CELL.get(kind, 0) for kind in run.values()) for run in kinds]
        states = [sum(STATE_BYTES.get(kind, 0) for kind in run.values()) for run in kinds]
        return cls(
            tables.grid.nx,
            tables.grid.ny,
            layers,
            BYTES_OF_A_CELL + max(memory),
            2 * (STATE_BYTES_OF_A_CELL + max(states)) + FILE_BYTES_OF_A_CELL_AND_LAYER * (layers + 1) * len(kinds),
        )

    @property
    def memory(self) -> int:
        """Bytes of memory."""
        return self.memory_of_a_cell * self.nx * self.ny

    @property
    def disk(self) -> int:
        """Bytes of disk in the run folder at most; the saved state is there twice while it is replaced."""
        return self.disk_of_a_cell * self.nx * self.ny

    def __str__(self) -> str:
        """A sentence for a person."""
        memory, disk = size_text(self.memory), size_text(self.disk)
        return f"about {self.layers} layers, {memory} of memory beyond that of the program, {disk} of disk"

    def memory_errors(self) -> Iterator[str]:
        """The error of a grid that memory cannot hold, with one that it can."""
        if reason := memory_error(self.memory):
            yield f"{self._grid()} {reason}; {self._advice((available_memory() or 0) / self.memory)}"

    def check_disk(self, folder: Path) -> None:
        """Raises ResultError where the disk of a run folder cannot hold the run."""
        free = free_disk(folder)
        if free is not None and self.disk > free:
            found = f"needs about {size_text(self.disk)} of disk, {size_text(free)} are free there"
            advice = f"{self._advice(free / self.disk)}, fewer layers, or another disk (--out)"
            raise ResultError(f"{folder}: {self._grid()} {found}; {advice}")

    def _grid(self) -> str:
        return f"grid of {self.nx} x {self.ny} cells, about {self.layers} layers,"

    def _advice(self, share: float) -> str:
        nx, ny = (max(1, math.floor(count * math.sqrt(share))) for count in (self.nx, self.ny))
        return f"{nx} x {ny} cells would fit: choose a smaller grid or a larger pitch"


def _layers(tables: ScenarioFile, height: float) -> int:
    """Layers of the nominal height, at most those that the run may have."""
    nominal = height / tables.ink.a.ink.layer_height
    return max(1, min(tables.run.layers_max, math.ceil(min(nominal, tables.run.layers_max) - ROUNDING)))

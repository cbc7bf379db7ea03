"""Record of one print for identification: jetted patterns and the surfaces measured between them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray

from inkloop.component import BoolMap, FloatMap
from inkloop.contract import HEIGHT, MEASURED_HEIGHT, PATTERN, VALID, PassOrder, pass_colours
from inkloop.errors import InkloopError
from inkloop.metrology.datum import Datum, level, reference_cells
from inkloop.results.result import Result
from inkloop.tables.schema import Process
from inkloop.units import UM_PER_M

CELLS_MIN = 20  # differences for a standard deviation to 16 % (assumed enough)


class IdentificationError(InkloopError):
    """Logged patterns and surfaces cannot be read, or do not determine the requested ink."""


@dataclass(frozen=True, eq=False)
class PrintedLayer:
    """Layer `number` (from 1 on). pattern: (nx, ny), 0 none, 1 material A, 2 material B; before, after: (nx, ny) as
    measured [m], NaN where nothing was; colours: of its passes in order, none for one pass.
    """

    number: int
    pattern: NDArray[np.int32]
    before: FloatMap
    after: FloatMap
    colours: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class PrintRecord:
    """One print. pitch [m]; pattern: (layers, nx, ny), 0 none, 1 material A, 2 material B; measured: (layers + 1, nx,
    ny), the start surface first [m], NaN where nothing was measured; area: (layers + 1, nx, ny) covered share of each
    cell, where it is known; passes, pass_order, pass_rotation as in the FMU LayerDeposition.
    """

    name: str
    pitch: float
    pattern: NDArray[np.int32]
    measured: NDArray[np.float64]
    area: NDArray[np.float64] | None = None
    passes: int = 1
    pass_order: int = 1
    pass_rotation: int = 0

    @property
    def shape(self) -> tuple[int, int]:
        """Cells along x and along y."""
        return self.pattern.shape[1], self.pattern.shape[2]

    @property
    def materials(self) -> int:
        """1, or 2 where material B was jetted."""
        return max(1, int(self.pattern.max(initial=0)))

    def layers(self) -> Iterator[PrintedLayer]:
        """The layers in the order of the print."""
        for k, pattern in enumerate(self.pattern):
            colours = pass_colours(self.passes, self.pass_order, self.pass_rotation, k + 1)
            yield PrintedLayer(k + 1, pattern, self.measured[k], self.measured[k + 1], colours)

    def first(self, layers: int) -> PrintRecord:
        """The print up to so many layers."""
        area = None if self.area is None else self.area[: layers + 1]
        return replace(self, pattern=self.pattern[:layers], measured=self.measured[: layers + 1], area=area)

    def untouched(self, margin: int) -> BoolMap:
        """(nx, ny) cells that have no droplet within `margin` cells in any layer."""
        return reference_cells(np.asarray((self.pattern > 0).any(axis=0)), margin)

    def levelled(self, datum: Datum, margin: int = 2) -> PrintRecord:
        """Every scan less the offset or the plane of the untouched cells. Raises HeightMapError for too few of them."""
        reference = self.untouched(margin)
        return replace(self, measured=np.stack([level(scan, reference, datum) for scan in self.measured]))


def noise_of(records: list[PrintRecord], margin: int = 2) -> float | None:
    """Standard deviation of a reading [m], from the differences between scans on cells that no droplet reached; None
    where there are fewer than CELLS_MIN such differences.
    """
    differences = []
    for record in records:
        still = record.untouched(margin)
        steps = np.diff(record.measured[:, still], axis=0)
        differences.append(steps[np.isfinite(steps)])
    found = np.concatenate(differences)
    return float(np.sqrt(np.mean(found**2) / 2.0)) if found.size >= CELLS_MIN else None


def first_guess(records: Sequence[PrintRecord]) -> float:
    """Mean height that a droplet adds to the whole grid [m], the start value of the widths. Raises
    IdentificationError.
    """
    growth = sum(float(np.nansum(np.diff(record.measured, axis=0))) for record in records)
    droplets = sum(int(np.count_nonzero(record.pattern)) for record in records)
    if droplets == 0:
        raise IdentificationError("no layer has a droplet; log the patterns as they were jetted")
    if growth <= 0.0:
        raise IdentificationError(
            f"the surface sank by {-growth / droplets * UM_PER_M:.3g} µm per droplet; expected it to grow; check the "
            "sign of the heights, the level of the scans (datum), and that each scan belongs to its pattern"
        )
    return growth / droplets


def read_run(folder: Path) -> PrintRecord:
    """The print of a run folder. Raises ResultError, IdentificationError."""
    return record_of(Result.load(folder), str(folder))


def record_of(result: Result, name: str) -> PrintRecord:
    """The print of a result: scans if there are any, else the reported surfaces. Raises IdentificationError.

    Rows of layers that were never scanned hold NaN; changes of a pattern by events are not in the record.
    """
    run = result.dataset
    surface = next((key for key in (MEASURED_HEIGHT, HEIGHT) if key in run), None)
    if surface is None or PATTERN not in run or run.sizes["layer"] < 2:
        raise IdentificationError(
            f"{name}: holds {', '.join(map(str, run.data_vars))} of {run.sizes['layer'] - 1} layers; needs pattern and "
            "measured_height of at least one layer"
        )
    measured = run[surface].values.astype(np.float64)
    if surface == MEASURED_HEIGHT and VALID in run:
        measured = np.where(run[VALID].values.astype(bool), measured, np.nan)
    process = Process.model_validate(tomlkit.parse(result.scenario_text).unwrap().get("process", {}))
    return PrintRecord(
        name,
        float(run.attrs["pitch"]),
        run[PATTERN].values[1:].astype(np.int32),
        measured,
        run["area"].values if "area" in run else None,
        process.passes,
        PassOrder[process.pass_order.upper()].value,
        process.pass_rotation,
    )

"""All prints of a study as labelled arrays: a dimension for each key, and the seeds.

The file depends on the study and on the records, in no way on the order in which prints ended: but for `wall_s` it has
the same bytes however often, and wherever, the study was interrupted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from inkloop import __version__
from inkloop.errors import ResultError
from inkloop.files import reason_of, replaced
from inkloop.results import netcdf
from inkloop.results.attributes import CONVENTIONS, Meaning, variable
from inkloop.units import GIGA, UNITS
from inkloop_lab.sweep.figures import METRICS
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Record

if TYPE_CHECKING:
    import xarray as xr

SWEEP_FILE = "sweep.nc"
SCHEMA_VERSION = 1
STATUSES = ("not_printed", "done", "layers_max", "time_max", "fault", "failed", "stopped")
"""Meanings of the codes of `status`; but for "not_printed" and "failed", stop reasons of a run."""
FAILING = ("fault", "failed", "stopped")
SEED, SAMPLE, TRIAL = "seed", "sample", "trial"
MAPS_MAX = 4 * int(GIGA)
"""Bytes of all last surfaces; more belong into run folders."""


def dataset(study: Study, folder: StudyFolder, trials: Sequence[Mapping[str, Any]] = ()) -> xr.Dataset:
    """Records of a study. trials: keys of each trial, where `[optimise]` chose them.

    Values that are not there are NaN or 0; `status` says why. Raises ResultError.
    """
    import xarray as xr

    shape = study.shape
    records = [record for record in folder.records.values() if record.point < study.count]
    seeds = max((record.replicate + 1 for record in records), default=study.tables.seeds.count)
    sizes, whole = (*shape.values(), seeds), (*shape, SEED)
    points = [tuple(map(int, place)) for place in np.ndindex(tuple(shape.values()))]
    places = {record.key: (*points[record.point], record.replicate) for record in records}
    variables: dict[str, xr.Variable] = {}
    found = {name for record in records for name in record.metrics}
    for name, (unit, meaning) in METRICS.items():
        if name in found:
            values = np.full(sizes, np.nan)
            for record in records:
                values[places[record.key]] = record.metrics.get(name, np.nan)
            variables[name] = variable(name, whole, values, unit, meaning)
    status, wall, error = np.zeros(sizes, np.int8), np.full(sizes, np.nan), np.full(sizes, "", object)
    for record in records:
        place = places[record.key]
        status[place], wall[place], error[place] = STATUSES.index(record.status), record.wall_s, record.error
    variables["status"] = variable("status", whole, status, "1", Meaning("how the print ended", flags=STATUSES))
    variables["error"] = xr.Variable(whole, error, {"long_name": "error of a print that failed"})
    clock = Meaning("wall-clock time of the print", others={"reproducible": "no: wall-clock"})
    variables["wall_s"] = variable("wall_s", whole, wall, "s", clock)
    grid = study.scenario.tables.grid
    coordinates = dict(_coordinates(study, trials))
    numbers = np.arange(study.first_seed, study.first_seed + seeds)
    coordinates[SEED] = variable(SEED, (SEED,), numbers, "1", Meaning("seed of the print, the same at every point"))
    if study.tables.keep.maps == "final":
        heights = _heights(folder, records, places, (*sizes, grid.nx, grid.ny))
        meaning = Meaning("surface after the last layer")
        variables["height"] = variable("height", (*whole, "x", "y"), heights, "m", meaning)
        coordinates["x"] = variable("x", ("x",), np.arange(grid.nx) * grid.pitch, "m")
        coordinates["y"] = variable("y", ("y",), np.arange(grid.ny) * grid.pitch, "m")
    attributes = {
        "Conventions": CONVENTIONS,
        "schema_version": SCHEMA_VERSION,
        "title": study.title,
        "study": study.text,
        "scenario": study.scenario.text,
        "source": f"inkloop {__version__}",
    }
    return xr.Dataset(variables, coordinates, attributes)


def write(sweep: xr.Dataset, folder: Path) -> Path:
    """Write the file of a study, whole or not at all; its path. Raises ResultError."""
    path = folder / SWEEP_FILE
    try:
        with replaced(path) as partial:
            partial.write_bytes(netcdf.packed(sweep))
    except (OSError, MemoryError) as error:
        raise ResultError(f"{path}: cannot be written: {reason_of(error)}") from error
    return path


def coordinate(key: str, dimension: str, values: Sequence[Any]) -> xr.Variable:
    """The values of a key of the scenario, in the unit that its name carries; lists and tables as JSON."""
    import xarray as xr

    plain = not any(isinstance(value, bool) or not isinstance(value, int | float) for value in values)
    if plain or all(isinstance(value, bool) for value in values):
        return variable(key, (dimension,), np.array(values), unit_of(key), Meaning(f"{key} of the scenario"))
    texts = [value if isinstance(value, str) else json.dumps(value, default=str) for value in values]
    return xr.Variable((dimension,), np.array(texts, object), {"long_name": f"{key} of the scenario"})


def unit_of(key: str) -> str:
    """The unit that the name of a key carries, "1" where it carries none."""
    suffixes = {unit.replace("1/", "per_").replace("/", "_per_"): unit for unit in UNITS}
    fitting = [suffix for suffix in suffixes if key.endswith(f"_{suffix}")]
    return suffixes[max(fitting, key=len)] if fitting else "1"


def _coordinates(study: Study, trials: Sequence[Mapping[str, Any]]) -> Any:
    for key, values in study.axes.items():
        yield key, coordinate(key, key, values)
    if study.samples is not None:
        meaning = Meaning("number of the point of [sample]")
        yield SAMPLE, variable(SAMPLE, (SAMPLE,), np.arange(len(study.samples)), "1", meaning)
        for key, values in study.samples.values.items():
            yield key, coordinate(key, SAMPLE, values)
        if study.samples.blocks:
            yield "block", coordinate("block", SAMPLE, study.samples.blocks)
    if study.tables.optimise:
        count = study.tables.optimise.trials
        yield TRIAL, variable(TRIAL, (TRIAL,), np.arange(count), "1", Meaning("number of the trial"))
        for key in study.search:
            known = [trial[key] for trial in trials]
            missing = "" if any(isinstance(value, str | list | dict | bool) for value in known) else float("nan")
            yield key, coordinate(key, TRIAL, [*known, *[missing] * (count - len(known))])


def _heights(
    folder: StudyFolder,
    records: Sequence[Record],
    places: Mapping[tuple[int, int], tuple[int, ...]],
    sizes: tuple[int, ...],
) -> NDArray[np.float64]:
    """All last surfaces [m]; NaN where there is none."""
    if 8 * np.prod(sizes, dtype=float) > MAPS_MAX:
        raise ResultError(f'keep.maps: all surfaces have {8 * np.prod(sizes) / GIGA:.1f} GB; write keep.maps = "all"')
    heights = np.full(sizes, np.nan)
    for record in records:
        if (height := folder.height(record)) is not None:
            heights[places[record.key]] = height
    return heights

"""Report on a run folder: one table and its pictures."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
import xarray as xr
from rich.table import Table

from inkloop.contract import LAYER_UNKNOWN
from inkloop.errors import ResultError
from inkloop.files import write_text
from inkloop.report import surface_parameters
from inkloop.report.model_difference import model_difference
from inkloop.report.terminal import FILE_WIDTH, Terminal, decimals, number_table
from inkloop.report.trust import untrusted_remarks
from inkloop.results.evaluated_surface import parameters_of
from inkloop.results.result import COMPARE_FOLDER, Result, read_record
from inkloop.tables.schema import Literature
from inkloop.units import UM_PER_M

MODEL_TABLE = "hardware-against-model.txt"
REMARKS = {
    "untrusted_cells": "untrusted cells: {}, unseen for too long, their heights are predictions",
    "dead_cells": "dead cells: {}, droplets commanded there bring nothing",
}
SCAN = ("shift_x", "shift_y", "shift_std", "spot_radius")
LENGTHS = ("mean_error", "mae", "std", "rms", "min", "max")
ERRORS = {"mean error": "mean_error", "mean absolute error": "mae", "standard deviation": "std"}


def load_runs(folder: Path, in_memory: Mapping[Path, Result] | None = None) -> dict[str, Result]:
    """The run of `folder` first, then its comparison runs, by name; those in memory, by folder, are not read.

    Raises ResultError.
    """
    known = in_memory or {}
    found = sorted(file.parent for file in (folder / COMPARE_FOLDER).glob("*/result.nc"))
    compared = [place for place in found if read_record(place).get("stop_reason") != "running"]
    runs = [known.get(place) or Result.load(place) for place in (folder, *compared)]
    return {result.dataset.attrs["label"]: result for result in runs}


def write(folder: Path, *, in_memory: Mapping[Path, Result] | None = None, pictures: bool = True) -> Table:
    """Write `summary.txt` and, if asked, the pictures of the run in `folder`; returns the table for the screen.

    Of a run on devices also `hardware-against-model.txt`, a row for each layer, and its picture. `in_memory` as for
    `load_runs`.
    """
    runs = load_runs(folder, in_memory)
    main = next(iter(runs.values()))
    tables = tomlkit.parse(main.scenario_text).unwrap().get("literature", {})
    literature = {name: Literature.model_validate(table) for name, table in tables.items()}
    table = comparison_table(main.dataset.attrs["title"], runs, literature)
    text = io.StringIO()
    summary = Terminal(text, width=FILE_WIDTH)
    summary.print(table)
    if surfaces := surface_parameters.table_of_runs(runs):
        summary.print(surfaces)
    for name, result in runs.items():
        refusals = surface_parameters.reasons(parameters_of(result.dataset))
        for remark in remarks(result) + [f"{symbols}: {reason}" for symbols, reason in refusals]:
            summary.print(f"{name}: {remark}")
    difference = model_difference(main)
    if difference:
        summary.print(difference.sentence())
        write_text(folder / MODEL_TABLE, _as_text(difference.table()))
    write_text(folder / "summary.txt", text.getvalue())
    if pictures:
        from inkloop.report.pictures import draw  # with Matplotlib, half the work of a short run

        draw(folder, runs, difference)
    return table


def compare(folders: Sequence[Path], picture: Path | None) -> tuple[Table, dict[str, Any]]:
    """The table of several run folders and the same as plain values; writes the picture. Raises ResultError."""
    loaded = {folder: Result.load(folder) for folder in folders}
    labels = [str(result.dataset.attrs["label"]) for result in loaded.values()]
    distinct = len(set(labels)) == len(labels)
    runs = {
        label if distinct else str(folder): result
        for label, (folder, result) in zip(labels, loaded.items(), strict=True)
    }
    grids = [(folder, _grid(result)) for folder, result in loaded.items()]
    for folder, grid in grids[1:]:
        if grid != grids[0][1]:
            raise ResultError(
                f"{folder}: printed on {grid}, but {grids[0][0]} on {grids[0][1]}; compare runs of one grid and pitch"
            )
    if picture:
        from inkloop.report.pictures import draw_comparison

        draw_comparison(runs, picture)
    return comparison_table("Comparison", runs, {}), {name: _figures(result) for name, result in runs.items()}


def _as_text(table: Table) -> str:
    text = io.StringIO()
    Terminal(text, width=FILE_WIDTH).print(table)
    return text.getvalue()


def _grid(result: Result) -> str:
    sizes = result.dataset.sizes
    return f"{sizes['x']} x {sizes['y']} cells of {float(result.dataset.attrs['pitch']) * UM_PER_M:g} um"


def comparison_table(title: str, runs: Mapping[str, Result], literature: Mapping[str, Literature]) -> Table:
    """Errors of every run over the part, next to published figures."""
    in_two_inks = any("mismatch" in result.metrics() for result in runs.values())
    mismatch = ("mis-\nmatch",) if in_two_inks else ()
    table = number_table(
        "run",
        *("mean\nerror", "mae", "std", *mismatch, "layers", "droplets", "wall\n[s]"),
        title=title,
        caption="errors over the part's cells in um; mean error = target - mean height",
    )
    for name, result in runs.items():
        metrics = result.metrics()
        table.add_row(
            name,
            *(decimals(metrics[key] * UM_PER_M) for key in ("mean_error", "mae", "std")),
            *(f"{metrics['mismatch']:.1%}" if "mismatch" in metrics else "-" for _ in mismatch),
            f"{metrics['layers']:.0f}",
            f"{metrics['droplets']:.0f}",
            f"{result.wall_s:.2f}",
        )
    for name, figures in literature.items():
        shown = (figures.mean_error_um, None, figures.std_um)
        cells = ["-" if um is None else f"{um:g}" for um in shown]
        table.add_row(f"{name} ({figures.note})", *cells, *("-" for _ in mismatch), *"---")
    return table


def record(folder: Path, in_memory: Mapping[Path, Result] | None = None) -> dict[str, Any]:
    """The figures of a run and its comparison runs as plain values, for `--json`; as `load_runs`."""
    runs = load_runs(folder, in_memory)
    return {"folder": folder, "runs": {name: _figures(result) for name, result in runs.items()}}


def _figures(result: Result) -> dict[str, Any]:
    """Errors in um, counts, the stop reason and remarks."""
    metrics = result.metrics()
    lengths = {f"{key}_um": metrics[key] * UM_PER_M for key in LENGTHS}
    counts = {key: int(metrics[key]) for key in ("layers", "droplets") if np.isfinite(metrics[key])}
    shares = {key: metrics[key] for key in ("mismatch",) if key in metrics}
    end = {"stop_reason": result.stop_reason, "wall_s": result.wall_s, "remarks": remarks(result)}
    surface = {parameter.key: parameter.shown for parameter in parameters_of(result.dataset)}
    return lengths | shares | counts | end | ({"surface": surface} if surface else {})


def remarks(result: Result) -> list[str]:
    """What the controller could not make good in its last layer, and where a shadow's model and the scans disagree.

    A sentence each; none where all is well.
    """
    counts = [(text, result.dataset[name]) for name, text in REMARKS.items() if name in result.dataset]
    found = [text.format(cells[-1].item()) for text, cells in counts if cells.dims == ("layer",) and cells[-1] > 0]
    run = result.dataset
    found += untrusted_remarks(run)
    return found + _corrected_scans(run) + _nothing_printed(result) + _unknown_layers(run) + _alarms(run)


def _corrected_scans(run: xr.Dataset) -> list[str]:
    """One sentence where the controller found that the sensor does not look where it should."""
    if "scan_corrected" not in run or not run.scan_corrected[-1]:
        return []
    x, y, std, spot = (float(run[f"scan_{name}"][-1]) * UM_PER_M for name in SCAN)
    wide = f", and the spot is {spot:.0f} um wide (standard deviation)" if spot > 0.0 else ""
    return [
        f"scans were corrected: the last one was shifted by {x:.1f} um along x and {y:.1f} um along y "
        f"(+- {std:.1f} um){wide}; register the profiler with the printer"
    ]


def _nothing_printed(result: Result) -> list[str]:
    """One sentence where the controller was done before the first layer."""
    if result.stop_reason != "done" or result.dataset.sizes["layer"] > 1:
        return []
    return [
        "nothing was printed: no layer would improve what the first scan shows. Where it shows an earlier part, "
        "clear the machine, or restart `inkloop bench`"
    ]


def _unknown_layers(run: xr.Dataset) -> list[str]:
    """One sentence on the layers that were aborted."""
    if LAYER_UNKNOWN not in run or not run.layer_unknown.any():
        return []
    layers = [str(layer) for layer in np.flatnonzero(run.layer_unknown.values)]
    which = f"layer {layers[0]} was" if len(layers) == 1 else f"layers {', '.join(layers)} were"
    return [f"{which} aborted, and what of it was jetted is unknown; the next one was planned from the scan"]


def _alarms(run: xr.Dataset) -> list[str]:
    """One sentence on the layers in which the shadow's status was untrusted or a fault."""
    if "shadow_status" not in run:
        return []
    growth = run.growth_divergence.values
    layers = np.flatnonzero(run.shadow_status.values > 0)
    unseen = [f"layer {layer} could not be compared with the model" for layer in layers if np.isnan(growth[layer])]
    strayed = [layer for layer in layers if not np.isnan(growth[layer])]
    if not strayed:
        return unseen[:1]
    worst = max(strayed, key=lambda layer: float(growth[layer]))
    others = f"; {len(strayed)} layers in all, the first is layer {strayed[0]}" if len(strayed) > 1 else ""
    remark = f"layer {worst} grew differently from the shadow's model, by {growth[worst] * UM_PER_M:.2f} um rms"
    return [f"{remark}{others}", *unseen[:1]]


def lines(folder: Path) -> list[str]:
    """Summary of a run folder: origin, end, errors, versions, times. Raises ResultError."""
    result = Result.load(folder)
    run, metrics = result.run, result.metrics()
    errors = ", ".join(f"{name} {decimals(metrics[key] * UM_PER_M)} um" for name, key in ERRORS.items())
    return [
        f"{folder}: {run['title']} ({run['label']})",
        f"grid: {_grid(result)}",
        f"seed: {run['seed']}",
        f"ended: {result.stop_reason}, after {metrics['layers']:.0f} layers and {metrics['droplets']:.0f} droplets",
        f"errors over the part: {errors}",
        *remarks(result),
        *(f"event: {event}" for event in run.get("events", ())),
        "versions: " + ", ".join(f"{name} {number}" for name, number in run["versions"].items()),
        f"platform: {run['platform']}",
        "wall time: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in run["wall_s"].items()),
    ]

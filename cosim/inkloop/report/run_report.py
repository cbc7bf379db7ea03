"""Report on a run folder: one table and its pictures."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomlkit
from rich.table import Table

from inkloop.errors import ResultError
from inkloop.files import write_text
from inkloop.report import surface_parameters
from inkloop.report.model_difference import ModelDifference, model_difference
from inkloop.report.remarks import remarks
from inkloop.report.terminal import FILE_WIDTH, Terminal, decimals, number_table
from inkloop.results.metrics import SIGN
from inkloop.results.result import COMPARE_FOLDER, UNFINISHED, Result, read_record
from inkloop.results.surface import parameters_of
from inkloop.tables.schema import Literature
from inkloop.units import NL_PER_M3, UM_PER_M

MODEL_TABLE = "hardware-against-model.txt"
LENGTHS = ("mean_error", "mae", "std", "rms", "min", "max")
CAPTION = f"errors over the part in µm: target minus height ({SIGN}); spill: ink beside the part"
ERRORS = {"mean error": "mean_error", "mean absolute error": "mae", "standard deviation": "std"}


def load_runs(folder: Path, in_memory: Mapping[Path, Result] | None = None) -> dict[str, Result]:
    """The run of `folder` first, then its comparison runs, by name; those in memory, by folder, are not read.

    Comparison runs that have not ended are left out, unless they are in memory. Raises ResultError.
    """
    known = in_memory or {}
    found = {file.parent for file in (folder / COMPARE_FOLDER).glob("*/result.nc")} | known.keys()
    compared = [
        place
        for place in sorted(found - {folder})
        if place in known or read_record(place).get("stop_reason") != "running"
    ]
    runs = [known.get(place) or Result.load(place) for place in (folder, *compared)]
    return {result.dataset.attrs["label"]: result for result in runs}


@dataclass(frozen=True, eq=False)
class Summary:
    """Content of `summary.txt`: a table of errors over the part, next to published figures, and remarks.

    headings: broken where a column is narrow; surface: the parameters that `[metrology]` asked for; difference: of a
    run on devices that has ended, from its model.
    """

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]
    remarks: Sequence[str]
    surface: Table | None = None
    difference: ModelDifference | None = None

    @classmethod
    def of(cls, runs: Mapping[str, Result]) -> Summary:
        """The summary of runs by name, the run itself first."""
        main = next(iter(runs.values()))
        tables = tomlkit.parse(main.scenario_text).unwrap().get("literature", {})
        literature = {name: Literature.model_validate(table) for name, table in tables.items()}
        difference = None if main.stop_reason == "running" else model_difference(main)
        found = []
        for name, result in runs.items():
            refusals = surface_parameters.reasons(parameters_of(result.dataset))
            found += [f"{name}: {remark}" for remark in remarks(result)]
            found += [f"{name}: {symbols}: {reason}" for symbols, reason in refusals]
        found += [difference.sentence()] if difference else []
        surface = surface_parameters.table_of_runs(runs)
        return cls(str(main.dataset.attrs["title"]), *_comparison(runs, literature), found, surface, difference)

    @property
    def table(self) -> Table:
        """The table for the screen."""
        table = number_table(*self.headings, title=self.title, caption=CAPTION)
        for row in self.rows:
            table.add_row(*row)
        return table

    def __str__(self) -> str:
        return _as_text(self.table, *([self.surface] if self.surface else []), *self.remarks)


def write(folder: Path, pictures: Sequence[str], in_memory: Mapping[Path, Result] | None = None) -> Table:
    """Write `summary.txt` and the pictures of the run in `folder`, in each format; returns the table for the screen.

    Of a run on devices also `hardware-against-model.txt`, a row for each layer, and its picture. `in_memory` as for
    `load_runs`.
    """
    runs = load_runs(folder, in_memory)
    summary = Summary.of(runs)
    if summary.difference:
        write_text(folder / MODEL_TABLE, _as_text(summary.difference.table()))
    write_text(folder / "summary.txt", str(summary))
    if pictures:
        from inkloop.report.pictures import draw  # Matplotlib takes half of the time of a short run

        draw(folder, runs, summary.difference, pictures)
    return summary.table


def compare(folders: Sequence[Path], picture: Path, formats: Sequence[str]) -> tuple[Table, dict[str, Any], list[Path]]:
    """The table of several run folders, the same as plain values, and the files of its picture, one for each format.

    Raises ResultError.
    """
    loaded = {folder: Result.load(folder) for folder in folders}
    labels = [str(result.dataset.attrs["label"]) for result in loaded.values()]
    distinct = len(set(labels)) == len(labels)
    runs = {
        label if distinct else str(folder): result
        for label, (folder, result) in zip(labels, loaded.items(), strict=True)
    }
    grids = [(folder, grid(result)) for folder, result in loaded.items()]
    for folder, printed_on in grids[1:]:
        if printed_on != grids[0][1]:
            raise ResultError(
                f"{folder}: printed on {printed_on}, but {grids[0][0]} on {grids[0][1]}; "
                "compare runs of one grid and pitch"
            )
    written: list[Path] = []
    if formats:
        from inkloop.report.pictures import draw_comparison

        written = draw_comparison(runs, picture, formats)
    return Summary("Comparison", *_comparison(runs, {}), ()).table, figures(runs), written


def _as_text(*parts: Table | str) -> str:
    text = io.StringIO()
    terminal = Terminal(text, width=FILE_WIDTH)
    for part in parts:
        terminal.print(part)
    return text.getvalue()


def grid(result: Result) -> str:
    """Cells and pitch of a run."""
    sizes = result.dataset.sizes
    return f"{sizes['x']} x {sizes['y']} cells of {float(result.dataset.attrs['pitch']) * UM_PER_M:g} µm"


def _comparison(runs: Mapping[str, Result], literature: Mapping[str, Literature]) -> tuple[list[str], list[list[str]]]:
    """The headings and rows of the table; the name of a run whose part is not complete says so."""
    metrics = {name: result.metrics() for name, result in runs.items()}
    mismatch = ["mis-\nmatch"] if any("mismatch" in each for each in metrics.values()) else []
    rows = [
        [
            f"{name}, {runs[name].stop_reason}" if runs[name].stop_reason in UNFINISHED else name,
            *(decimals(each[key] * UM_PER_M) for key in ("mean_error", "mae", "std")),
            *(f"{each['mismatch']:.1%}" if "mismatch" in each else "-" for _ in mismatch),
            f"{each['layers']:.0f}",
            f"{each['droplets']:.0f}",
            f"{each['spill'] * NL_PER_M3:.4g}",
            f"{runs[name].wall_s:.2f}" if np.isfinite(runs[name].wall_s) else "-",
        ]
        for name, each in metrics.items()
    ]
    for name, published in literature.items():
        lengths = (published.mean_error_um, None, published.std_um)
        cells = ["-" if um is None else f"{um:g}" for um in lengths]
        rows.append([f"{name} ({published.note})", *cells, *("-" for _ in mismatch), *"----"])
    return ["run", "mean\nerror", "mae", "std", *mismatch, "layers", "droplets", "spill\n[nl]", "wall\n[s]"], rows


def record(folder: Path, in_memory: Mapping[Path, Result] | None = None) -> dict[str, Any]:
    """The figures of a run and its comparison runs as plain values, for `--json`; as `load_runs`."""
    return {"folder": folder, "runs": figures(load_runs(folder, in_memory))}


def figures(runs: Mapping[str, Result]) -> dict[str, dict[str, Any]]:
    """The figures of runs by name as plain values, for `--json`."""
    return {name: _figures(result) for name, result in runs.items()}


def _figures(result: Result) -> dict[str, Any]:
    """Errors in um, counts, the stop reason and remarks."""
    metrics = result.metrics()
    lengths = {f"{key}_um": metrics[key] * UM_PER_M for key in LENGTHS}
    counts = {key: int(metrics[key]) for key in ("layers", "droplets") if np.isfinite(metrics[key])}
    shares = {key: metrics[key] for key in ("mismatch",) if key in metrics} | {"spill_nl": metrics["spill"] * NL_PER_M3}
    end = {"stop_reason": result.stop_reason, "wall_s": result.wall_s, "remarks": remarks(result)}
    surface = {parameter.key: parameter.shown for parameter in parameters_of(result.dataset)}
    return lengths | shares | counts | end | ({"surface": surface} if surface else {})


def lines(folder: Path) -> list[str]:
    """Summary of a run folder: origin, end, errors, versions, times. Raises ResultError."""
    result = Result.load(folder)
    run, metrics = result.run, result.metrics()
    errors = ", ".join(f"{name} {decimals(metrics[key] * UM_PER_M)} µm" for name, key in ERRORS.items())
    return [
        f"{folder}: {run['title']} ({run['label']})",
        f"grid: {grid(result)}",
        f"seed: {run['seed']}",
        f"ended: {result.stop_reason}, after {metrics['layers']:.0f} layers and {metrics['droplets']:.0f} droplets",
        f"errors over the part ({SIGN}): {errors}",
        *remarks(result),
        *(f"event: {event}" for event in run.get("events", ())),
        "versions: " + ", ".join(f"{name} {number}" for name, number in run["versions"].items()),
        f"platform: {run['platform']}",
        "wall time: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in run["wall_s"].items()),
    ]

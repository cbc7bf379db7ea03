"""The scores as tables: for the terminal, a page, a paper and a spreadsheet, and as a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from rich.table import Table

from inkloop import __version__
from inkloop.component import Ink
from inkloop.report.plot import WIDTH_IN
from inkloop.studies.score import VERSION
from inkloop.studies.score.board import METRICS, OPEN_LOOP, Score, fingerprint, relative
from inkloop.units import UM_PER_M

CAPTION = "rms error over the part in um, mean over the seeds; score: geometric mean of rms over that of the open loop"


def how_to_cite(seeds: Sequence[int]) -> str:
    """One sentence that makes a table comparable."""
    return (
        f"inkloop {__version__}, score board {VERSION} (plants {fingerprint()}), seeds "
        f"{', '.join(map(str, seeds))}; cite inkloop (CITATION.cff) and the papers of the plants."
    )


def terminal_table(scores: Sequence[Score]) -> Table:
    """A row for each controller, a column for each plant; the best of a plant in bold."""
    plants, names, cells = _cells(scores)
    table = Table(title=f"score board {VERSION}", caption=CAPTION)
    table.add_column("controller", no_wrap=True)
    for plant in (*plants, "score"):
        table.add_column(plant, justify="right", overflow="fold")
    best = np.nanmin(cells, axis=0)
    for name, row in zip(names, cells, strict=True):
        shown = [
            f"[bold]{value:.2f}[/bold]" if value == least else _text(value)
            for value, least in zip(row, best, strict=True)
        ]
        table.add_row(name, *shown)
    return table


def markdown(scores: Sequence[Score], seeds: Sequence[int]) -> str:
    """The same as a page."""
    plants, names, cells = _cells(scores)
    lines = [f"| controller | {' | '.join((*plants, 'score'))} |", f"|---|{'---:|' * (len(plants) + 1)}"]
    lines += [f"| {name} | {' | '.join(map(_text, row))} |" for name, row in zip(names, cells, strict=True)]
    lines += ["", f"{CAPTION}. {how_to_cite(seeds)}", "", "Ink assumed by each controller, h1, h2, h3 in um:", ""]
    inks = {(score.plant, score.entry.name): score.ink for score in scores}
    lines += [f"| controller | {' | '.join(plants)} |", f"|---|{'---|' * len(plants)}"]
    lines += [f"| {name} | {' | '.join(_ink(inks[plant, name]) for plant in plants)} |" for name in names]
    return "\n".join([*lines, ""])


def _ink(ink: Ink) -> str:
    return ", ".join(f"{h * UM_PER_M:.2f}" for h in (ink.h1, ink.h2, ink.h3))


def latex(scores: Sequence[Score], seeds: Sequence[int]) -> str:
    """The same for a paper, with the package booktabs."""
    plants, names, cells = _cells(scores)
    rows = [f"{name} & {' & '.join(map(_text, row))} \\\\" for name, row in zip(names, cells, strict=True)]
    return "\n".join(
        [
            f"% {CAPTION}",
            f"% {how_to_cite(seeds)}",
            f"\\begin{{tabular}}{{l{'r' * (len(plants) + 1)}}}",
            "\\toprule",
            f"controller & {' & '.join((*plants, 'score'))} \\\\",
            "\\midrule",
            *rows,
            "\\bottomrule",
            "\\end{tabular}",
            "",
        ]
    )


def spreadsheet(scores: Sequence[Score], seeds: Sequence[int]) -> str:
    """Every print: plant, controller, seed and all metrics, lengths in micrometres."""
    text = io.StringIO()
    writer = csv.writer(text)
    lengths = {metric for metric in METRICS if metric not in ("layers", "droplets")}
    writer.writerow(["plant", "controller", "kind", "seed", *(f"{m}_um" if m in lengths else m for m in METRICS)])
    for score in scores:
        for number, seed in enumerate(seeds):
            values = [score.figures[m][number] * (1e6 if m in lengths else 1.0) for m in METRICS]
            writer.writerow([f"{VERSION}/{score.plant}", score.entry.name, score.entry.kind, seed, *values])
    return text.getvalue()


def picture(scores: Sequence[Score]) -> Figure:
    """Rms of each controller on each plant, coloured by how it compares with the open loop."""
    plants, names, cells = _cells(scores)
    rms, reference = cells[:, :-1], cells[names.index(OPEN_LOOP.name), :-1]
    figure = Figure(figsize=(WIDTH_IN, 1.3 + 0.26 * len(names)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(rms / reference, cmap="RdYlGn_r", norm=LogNorm(0.02, 50.0), aspect="auto")
    for (row, column), value in np.ndenumerate(rms):
        axes.text(column, row, _text(value), ha="center", va="center", fontsize=7)
    axes.set_xticks(range(len(plants)), [plant.replace("-", "-\n", 1) for plant in plants])
    axes.set_yticks(range(len(names)), names)
    axes.set_title("rms error [µm] by controller and plant")
    figure.colorbar(image, ax=axes, label="over open loop", format="{x:g}")
    return figure


def _cells(scores: Sequence[Score]) -> tuple[list[str], list[str], np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Plants, controllers, and rms [um] of each on each, the score last; NaN where it was not printed."""
    plants = list(dict.fromkeys(score.plant for score in scores))
    names = list(dict.fromkeys(score.entry.name for score in scores))
    rms = {(score.entry.name, score.plant): score.mean("rms") for score in scores}
    cells = [[rms.get((name, plant), np.nan) for plant in plants] + [relative(scores, name)] for name in names]
    return plants, names, np.array(cells)


def _text(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"

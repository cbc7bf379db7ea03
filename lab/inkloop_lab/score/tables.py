"""The scores as tables: for the terminal, a page, a paper and a spreadsheet, and as a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from inkloop import __version__
from inkloop.report.plot import WIDTH_IN
from inkloop.report.terminal import number_table
from inkloop.units import UM_PER_M
from inkloop_lab.score.board import HIGH_UM, METRICS, OPEN_LOOP, Score, fingerprint, relative

CAPTION = "rms error over the part in µm, mean over the seeds; score: geometric mean of rms over that of the open loop"
HIGHEST = (
    "Highest cell above the target in µm, of all seeds; **bold**: higher than every cell of the open loop, and more "
    f"than {HIGH_UM:g} µm above the target."
)


def by_version(scores: Sequence[Score]) -> dict[str, list[Score]]:
    """The scores on the plants of each version, which are compared with each other only."""
    return {
        version: [score for score in scores if score.version == version]
        for version in dict.fromkeys(score.version for score in scores)
    }


def how_to_cite(version: str, seeds: Sequence[int]) -> str:
    """One sentence for citing a table."""
    return (
        f"inkloop {__version__}, score board {version} (plants {fingerprint(version)}), seeds "
        f"{', '.join(map(str, seeds))}; cite inkloop (CITATION.cff) and the papers of the plants."
    )


def terminal_table(version: str, scores: Sequence[Score]) -> Table:
    """A row for each controller, a column for each plant of a version; the best of a plant in bold."""
    plants, names, cells = _cells(scores)
    headings = [plant.replace("-", "-\n") for plant in (*plants, "score")]
    table = number_table("controller", *headings, title=f"score board {version}", caption=CAPTION)
    best = np.nanmin(cells, axis=0)
    for name, row in zip(names, cells, strict=True):
        shown = [
            Text(f"{value:.2f}", "bold") if value == least else _text(value)
            for value, least in zip(row, best, strict=True)
        ]
        table.add_row(name, *shown)
    return table


def markdown(scores: Sequence[Score], seeds: Sequence[int]) -> str:
    """The same as a page, a section for each version."""
    return "\n".join(
        line
        for version, own in by_version(scores).items()
        for line in (f"## {version}", "", *_page(own, version, seeds))
    )


def _page(scores: Sequence[Score], version: str, seeds: Sequence[int]) -> list[str]:
    plants, names, cells = _cells(scores)
    rms = [[name, *map(_text, row)] for name, row in zip(names, cells, strict=True)]
    found = {(score.entry.name, score.plant): score for score in scores}

    def shown(of: Callable[[Score, Score], str]) -> list[list[str]]:
        printed = [[found.get((name, f"{version}/{plant}")) for plant in plants] for name in names]
        open_loop = printed[names.index(OPEN_LOOP.name)]
        return [
            [name, *(of(own, blind) if own and blind else "-" for own, blind in zip(row, open_loop, strict=True))]
            for name, row in zip(names, printed, strict=True)
        ]

    return [
        *_rows([*plants, "score"], rms, right=True),
        f"{CAPTION}. {how_to_cite(version, seeds)}",
        "",
        HIGHEST,
        "",
        *_rows(plants, shown(_highest), right=True),
        "Ink assumed by each controller, h1, h2, h3 in µm:",
        "",
        *_rows(plants, shown(_ink), right=False),
    ]


def _rows(headings: Sequence[str], rows: Sequence[Sequence[str]], *, right: bool) -> list[str]:
    """A table with the controllers in the first column, and an empty line."""
    rule = "---:|" if right else "---|"
    return [
        f"| controller | {' | '.join(headings)} |",
        f"|---|{rule * len(headings)}",
        *(f"| {' | '.join(row)} |" for row in rows),
        "",
    ]


def _highest(score: Score, open_loop: Score) -> str:
    return f"**{score.highest_um:.2f}**" if score.ends_above(open_loop) else f"{score.highest_um:.2f}"


def _ink(score: Score, _: Score) -> str:
    return ", ".join(f"{h * UM_PER_M:.2f}" for h in (score.ink.h1, score.ink.h2, score.ink.h3))


def latex(scores: Sequence[Score], seeds: Sequence[int]) -> str:
    """The same for a paper, with the package booktabs."""
    return "\n".join(_tabular(own, version, seeds) for version, own in by_version(scores).items())


def _tabular(scores: Sequence[Score], version: str, seeds: Sequence[int]) -> str:
    plants, names, cells = _cells(scores)
    rows = [f"{name} & {' & '.join(map(_text, row))} \\\\" for name, row in zip(names, cells, strict=True)]
    return "\n".join(
        [
            f"% {CAPTION}",
            f"% {how_to_cite(version, seeds)}",
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
            values = [score.figures[m][number] * (UM_PER_M if m in lengths else 1.0) for m in METRICS]
            writer.writerow([score.plant, score.entry.name, score.entry.kind, seed, *values])
    return text.getvalue()


def picture(scores: Sequence[Score]) -> Figure:
    """Rms of each controller on each plant, coloured by the ratio to the open loop, by version."""
    versions = by_version(scores)
    count = len({score.entry.name for score in scores})
    figure = Figure(figsize=(WIDTH_IN, len(versions) * (1.0 + 0.26 * count) + 0.3), layout="constrained")
    panels = figure.subplots(len(versions), squeeze=False)[:, 0]
    for axes, (version, own) in zip(panels, versions.items(), strict=True):
        plants, names, cells = _cells(own)
        rms, reference = cells[:, :-1], cells[names.index(OPEN_LOOP.name), :-1]
        image = axes.imshow(rms / reference, cmap="cividis", norm=LogNorm(0.02, 2.0), aspect="auto")
        for (row, column), value in np.ndenumerate(rms):
            red, green, blue, _ = image.to_rgba(value / reference[column])
            ink = "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
            axes.text(column, row, _text(value), ha="center", va="center", fontsize=7, color=ink)
        axes.set_xticks(range(len(plants)), [plant.replace("-", "-\n", 1) for plant in plants])
        axes.set_yticks(range(len(names)), names)
        axes.set_title(f"{version}: rms error [µm] by controller and plant")
    figure.colorbar(image, ax=list(panels), label="relative to open loop", extend="both", format="{x:g}")
    return figure


def _cells(scores: Sequence[Score]) -> tuple[list[str], list[str], np.ndarray[tuple[int, ...], np.dtype[np.float64]]]:
    """Plants of a version, controllers, and rms [µm] of each on each, the score last; NaN where it was not printed."""
    plants = list(dict.fromkeys(score.plant for score in scores))
    names = list(dict.fromkeys(score.entry.name for score in scores))
    rms = {(score.entry.name, score.plant): score.mean("rms") for score in scores}
    cells = [[rms.get((name, plant), np.nan) for plant in plants] + [relative(scores, name)] for name in names]
    return [plant.partition("/")[2] for plant in plants], names, np.array(cells)


def _text(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.2f}"

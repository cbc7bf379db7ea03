"""Picture of use-the-modelica-library.md, and the reference results of the library's examples."""

from __future__ import annotations

import csv
from collections.abc import Callable

import numpy as np
import rumoca
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from tools.figures.pages import DOCS, ROOT, Texts

from inkloop.files import replaced
from inkloop.report.plot import COLOURS, STYLE, WIDTH_IN, save
from inkloop.units import UM_PER_M
from support.fmus.modelica_library import (
    REFERENCE_MODELS,
    comparison_signals,
    reference_file,
    rows_of,
    simulate,
    stop_time,
)

FOLDER = DOCS / "how-to"
LIBRARY = ROOT / "models/InkLoop/package.mo"
EXAMPLES = {"CylinderOpenLoop": (8.0, "open loop"), "CylinderThresholdFeedback": (14.0, "threshold feedback")}
CELLS = 11
MIDDLE = 6


def section_by_layer(example: str, stop: float) -> list[np.ndarray]:
    """The row of cells through the middle after every layer [m], across the columns that the nozzles jet."""
    run = rumoca.Session().load(str(LIBRARY), model=f"InkLoop.Examples.{example}").simulate(t=(0.0, stop), dt=0.5)
    layers = run["deposition.layers_printed"]
    row = np.array([run[f"deposition.height[{MIDDLE},{j}]"] for j in range(1, CELLS + 1)])
    return [row[:, np.flatnonzero(layers == layer)[-1]] for layer in np.unique(layers)[1:]]


def draw(axes: Axes, sections: list[np.ndarray], title: str) -> None:
    """One line per layer, the last one strong, and the target."""
    cells = np.arange(1, CELLS + 1)
    for section in sections:
        axes.step(cells, section * UM_PER_M, where="mid", color="0.7", linewidth=0.8)
    axes.step(cells, sections[-1] * UM_PER_M, where="mid", color=COLOURS[0], linewidth=1.8, label="last layer")
    axes.hlines(45.6, 1.5, 10.5, color=COLOURS[1], linestyle="--", linewidth=1.0, label="six nominal layers")
    axes.set(title=f"{title}, {len(sections)} layers", xlabel="cell along y", xticks=cells[::2])


def picture() -> Figure:
    """Both examples side by side."""
    with rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, 0.42 * WIDTH_IN), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for axes, (example, (stop, title)) in zip(panels, EXAMPLES.items(), strict=True):
            draw(axes, section_by_layer(example, stop), title)
        panels[0].set_ylabel("height [µm]")
        panels[0].legend(loc="upper right", bbox_to_anchor=(1.0, 0.93))
        return figure


def write_reference_results(model: str) -> None:
    """The comparison signals of an example as CSV, next to their names, in the form of the library projects.

    Numbers are the shortest decimals that read back as the same number.
    """
    signals = comparison_signals(model)
    with replaced(reference_file(model)) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, quoting=csv.QUOTE_NONNUMERIC, lineterminator="\n")
        writer.writerow(signals)
        writer.writerows(rows_of(simulate(model, stop_time(model)), signals))


def references() -> None:
    """The reference results of every model that names comparison signals."""
    for model in REFERENCE_MODELS:
        write_reference_results(model)


def run(*parts: str) -> None:
    """Draw the picture and write the reference results, or one of the two."""
    for part in parts or PARTS:
        PARTS[part]()


PARTS: dict[str, Callable[[], object]] = {
    "picture": lambda: save(picture(), FOLDER / "modelica-library.png"),
    "references": references,
}


def texts() -> Texts:
    """None: the page shows a picture alone."""
    return {}

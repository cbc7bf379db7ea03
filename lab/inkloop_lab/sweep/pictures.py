"""Pictures of a study: main effects, a map of two keys, the front of roughness against layers, indices, the search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from inkloop.report import plot
from inkloop_lab.sweep.figures import heading, label
from inkloop_lab.sweep.plan import standard_error
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.summary import keys_of, short_names

BINS = 8
"""Groups of sampled values whose means show an effect."""
PANELS = 4
"""In a row."""
NAMED_MAX = 3
"""Keys up to which the points of the front carry their setting."""
Points = Sequence[Mapping[str, Any]]


def pictures(study: Study, points: Points, sweep: Any, values: Sequence[float] = ()) -> dict[str, Figure]:
    """Name -> picture, those that the study has anything for. values: of the trials of a search."""
    shown = label(study.tables.metric)
    known = [point for point in points if point.get(shown) is not None]
    found: dict[str, Figure] = {}
    with rc_context(plot.STYLE):
        if not known:
            return found
        keys = [key for key in keys_of(study) if len({repr(point["keys"][key]) for point in known}) > 1]
        if keys:
            found["main-effects"] = _main_effects(known, keys, shown)
        if len(pair := _strongest_pair(known, keys, list(study.axes), shown)) == 2:
            found["heat-map"] = _heat_map(known, pair, shown)
        if len({(point["std_um"], point["layers"]) for point in known}) > 1:
            found["front"] = _front(known, keys)
        if "first_order" in sweep:
            found["sensitivities"] = _sensitivities(sweep.sel(metric=study.tables.metric), study.tables.metric)
        if values and study.tables.optimise:
            found["search"] = _search(values, study)
    return found


def _words(shown: str) -> str:
    name = heading(shown.removesuffix("_um")).replace("_", " ")
    return f"{name} [µm]" if shown.endswith("_um") else name


def _main_effects(points: Points, keys: Sequence[str], shown: str) -> Figure:
    """Mean of the figure at each value of a key, over all other keys.

    Bars are standard errors: of the seeds of these points, or of the points in a group where a key is sampled.
    """
    names = short_names(keys)
    columns = min(PANELS, len(keys))
    rows = -(-len(keys) // columns)
    figure = plot.new_figure(1.9 * rows + 0.3)
    panels = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel()
    for axes, key in zip(panels, keys, strict=False):
        values, figures = [point["keys"][key] for point in points], np.array([point[shown] for point in points])
        groups, ticks = _groups(values)
        at = [float(np.mean(place)) for place, _ in groups]
        mean = [float(figures[members].mean()) for _, members in groups]
        scatter = np.array([point[f"{shown}_standard_error"] for point in points])
        error = [_error(figures[own], scatter[own], is_sampled=ticks is None) for _, own in groups]
        if ticks is None:
            axes.plot([float(value) for value in values], figures, ".", color="0.75", markersize=3, zorder=1)
        axes.errorbar(at, mean, error, color=plot.COLOURS[0], marker="o", markersize=4, capsize=2)
        if ticks is not None:
            axes.set_xticks(at, ticks)
        axes.set_xlabel(names[key])
        axes.grid(alpha=0.3)
    for axes in panels[len(keys) :]:
        axes.set_visible(False)
    for axes in panels[::columns]:
        axes.set_ylabel(_words(shown))
    return figure


def _error(figures: NDArray[np.float64], scatter: NDArray[np.float64], *, is_sampled: bool) -> float:
    """Standard error of the mean of some points, 0 where nothing is known of it."""
    if is_sampled:
        return standard_error(list(figures)) if len(figures) > 1 else 0.0
    known = np.isfinite(scatter).all()
    return float(np.sqrt(np.square(scatter).sum()) / len(scatter)) if known else 0.0


def _groups(values: Sequence[Any]) -> tuple[list[tuple[Any, NDArray[np.bool_]]], list[str] | None]:
    """Places along x with the points at each; their names, None where a number was sampled and is grouped by size."""
    own = list(dict.fromkeys(map(repr, values)))
    texts = np.array([repr(value) for value in values])
    is_number = all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)
    if len(own) <= BINS or not is_number:
        order = sorted(own, key=float) if is_number else own
        return [([n], texts == text) for n, text in enumerate(order)], [text.strip("'") for text in order]
    numbers = np.array(values, np.float64)
    edges = np.quantile(numbers, np.linspace(0.0, 1.0, BINS + 1))
    place = np.clip(np.searchsorted(edges, numbers, "right") - 1, 0, BINS - 1)
    return [(numbers[place == n], place == n) for n in range(BINS) if (place == n).any()], None


def _strongest_pair(points: Points, keys: Sequence[str], axes: Sequence[str], shown: str) -> list[str]:
    """The two keys of `[vary]` whose values change the figure most."""
    own = [key for key in keys if key in axes]

    def effect(key: str) -> float:
        groups, _ = _groups([point["keys"][key] for point in points])
        figures = np.array([point[shown] for point in points])
        return float(np.ptp([figures[members].mean() for _, members in groups]))

    strongest = sorted(own, key=effect, reverse=True)[:2]
    return [key for key in own if key in strongest]


def _heat_map(points: Points, pair: Sequence[str], shown: str) -> Figure:
    """Mean of the figure over all points with the same values of two keys."""
    names = short_names([*points[0]["keys"]])
    (columns, across), (rows, down) = (_groups([point["keys"][key] for point in points]) for key in pair)
    figures = np.array([point[shown] for point in points])
    cells = np.array(
        [[figures[here & there].mean() if (here & there).any() else np.nan for _, here in columns] for _, there in rows]
    )
    figure = plot.new_figure(0.8 + 0.42 * len(rows))
    axes = figure.subplots()
    image = axes.imshow(cells, cmap="cividis", aspect="auto", origin="lower")
    for (row, column), value in np.ndenumerate(cells):
        red, green, blue, _ = image.to_rgba(value)
        colour = "black" if 0.3 * red + 0.6 * green + 0.1 * blue > 0.5 else "white"
        text = "-" if np.isnan(value) else f"{value:.3g}"
        axes.text(column, row, text, ha="center", va="center", fontsize=7, color=colour)
    axes.set_xticks(range(len(columns)), across or [f"{np.mean(at):.3g}" for at, _ in columns])
    axes.set_yticks(range(len(rows)), down or [f"{np.mean(at):.3g}" for at, _ in rows])
    axes.set(xlabel=names[pair[0]], ylabel=names[pair[1]])
    figure.colorbar(image, label=_words(shown), format="{x:g}")
    return figure


def _front(points: Points, keys: Sequence[str]) -> Figure:
    """Roughness against layers, a mark for each point; a line joins the points that no other beats in both."""
    names = short_names(keys)
    at = np.array([[point["layers"], point["std_um"]] for point in points])
    best = [n for n, own in enumerate(at) if not any((other <= own).all() and (other < own).any() for other in at)]
    best.sort(key=lambda n: tuple(at[n]))
    figure = plot.new_figure(3.2)
    axes = figure.subplots()
    axes.plot(at[:, 0], at[:, 1], "o", color="0.7", markersize=4, label="points")
    axes.plot(at[best, 0], at[best, 1], "o-", color=plot.COLOURS[1], markersize=5, label="Pareto front")
    middle = (at[:, 0].min() + at[:, 0].max()) / 2
    for n in best[:: max(1, len(best) // 6)] if len(keys) <= NAMED_MAX else ():
        setting = ", ".join(f"{names[key]} {_short(points[n]['keys'][key])}" for key in keys)
        side: dict[str, Any] = {"ha": "left"} if at[n, 0] <= middle else {"ha": "right"}
        shift = (5 if side["ha"] == "left" else -5, 4)
        axes.annotate(setting, at[n], xytext=shift, textcoords="offset points", fontsize=6, **side)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="layers", ylabel="std [µm]")
    axes.margins(0.1)
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def _sensitivities(of_metric: Any, metric: str) -> Figure:
    """First order and total of each key with their intervals; the mean over other keys of the study."""
    keys = [str(key) for key in of_metric["key"].values]
    names = short_names(keys)
    figure = plot.new_figure(1.0 + 0.35 * len(keys))
    axes: Axes = figure.subplots()
    for number, (order, words) in enumerate({"first_order": "alone", "total_order": "with interactions"}.items()):
        others = [name for name in of_metric[order].dims if name != "key"]
        value, low, high = (of_metric[f"{order}{end}"].mean(others).values for end in ("", "_low", "_high"))
        places = np.arange(len(keys)) + 0.36 * (number - 0.5)
        axes.barh(places, value, 0.34, color=plot.COLOURS[number], label=words)
        reach = np.maximum([value - low, high - value], 0.0)
        axes.errorbar(value, places, xerr=reach, fmt="none", color="black", capsize=2, linewidth=0.8)
    axes.set_yticks(range(len(keys)), [names[key] for key in keys])
    axes.invert_yaxis()
    axes.set_xlabel(f"share of the variance of {metric.replace('_', ' ')}")
    axes.legend()
    axes.grid(axis="x", alpha=0.3)
    return figure


def _search(values: Sequence[float], study: Study) -> Figure:
    """The value of each trial, and the best one so far."""
    table = study.tables.optimise
    best = np.fmin.accumulate(values) if table and table.minimise else np.fmax.accumulate(values)
    figure = plot.new_figure(2.6)
    axes = figure.subplots()
    axes.plot(values, "o", color="0.6", markersize=4, label="trial")
    axes.plot(best, drawstyle="steps-post", color=plot.COLOURS[0], label="best so far")
    axes.set(xlabel="trial", ylabel=table.expression.text if table else "")
    axes.legend()
    axes.grid(alpha=0.3)
    return figure


def _short(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)

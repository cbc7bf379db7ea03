"""Curves of a print: a cut through its middle, and its development layer by layer."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, LogLocator, MaxNLocator

from inkloop.report.plot import (
    ERROR_LABEL,
    Runs,
    draw_line,
    middle_row,
    new_figure,
    outside_legend,
)
from inkloop.results.metrics import TOO_HIGH, TOO_LOW, error_of
from inkloop.units import MM_PER_M, UM_PER_M

__all__ = ["cross_section"]

FAR_UM = 10.0  # a run that misses by more than this is not drawn with the others
LINEAR_UM = 1.0  # mean errors are drawn to scale up to this, beyond by their logarithm


def cross_section(runs: Runs) -> Figure:
    """Cut through the middle of the part: whole height above, the error of the top below."""
    figure = new_figure(4.4)
    whole, top = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    name, first = next(iter(runs.items()))
    row = middle_row(first)
    x = first.x.values * MM_PER_M
    every = max(1, first.sizes["layer"] // 10)
    for layer in range(0, first.sizes["layer"] - 1, every):
        label = f"{name}, every {f'{every} layers' if every > 1 else 'layer'}" if layer == 0 else None
        cut = first.height[layer, :, row].values * UM_PER_M
        whole.step(x, cut, where="mid", color="0.75", linewidth=0.7, label=label)
    target = first.target_height[:, row].values * UM_PER_M
    whole.step(x, target, where="mid", color="black", linestyle="--", linewidth=1, label="target")
    errors = {name: error_of(run)[:, row] for name, run in runs.items()}
    near = [error for error in errors.values() if abs(np.nanmean(error)) < FAR_UM] or list(errors.values())
    limit = max(0.1, *(1.2 * float(np.nanmax(np.abs(error))) for error in near))
    outside = []
    for number, (name, run) in enumerate(runs.items()):
        draw_line(whole, number, x, run.height[-1, :, row].values * UM_PER_M, name, ends=False, drawstyle="steps-mid")
        part = np.flatnonzero(np.isfinite(errors[name]))
        draw_line(top, number, x[part], errors[name][part], ends=False, drawstyle="steps-mid")
        mean = float(np.nanmean(errors[name]))
        if abs(mean) > limit:
            outside.append(f"{name}: {abs(mean):.0f} µm {TOO_LOW if mean > 0 else TOO_HIGH}, outside the frame")
    whole.set(ylabel="height [µm]", ylim=(0, None), title=f"cut at y = {float(first.y[row]) * MM_PER_M:.2f} mm")
    handles, labels = whole.get_legend_handles_labels()
    outside_legend(figure, handles, labels)
    top.axhline(0, color="black", linestyle="--", linewidth=1)
    top.set(xlabel="x [mm]", ylabel=ERROR_LABEL, ylim=(-limit, limit))
    top.set_title("; ".join(outside), loc="left", fontsize="medium")
    return figure


def layers(runs: Runs) -> Figure:
    """Mean error, unevenness and droplets, layer by layer."""
    figure = new_figure(5.2)
    mean, spread, droplets = figure.subplots(3, 1, sharex=True)
    draw_layers(mean, spread, droplets, runs)
    mean.set(ylabel=f"mean {ERROR_LABEL}")
    spread.set(ylabel="std over the part [µm]")
    droplets.set(ylabel="droplets", xlabel="layer")
    handles, labels = mean.get_legend_handles_labels()
    outside_legend(figure, handles, labels, above=True)
    return figure


def draw_layers(mean: Axes, spread: Axes, droplets: Axes, runs: Runs) -> None:
    """The curves of `layers` on axes that have no labels yet."""
    for number, (name, run) in enumerate(runs.items()):
        layer = run.layer.values
        draw_line(mean, number, layer, run.mean_error.values * UM_PER_M, name)
        draw_line(spread, number, layer[1:], run["std"].values[1:] * UM_PER_M)
        if "pattern" in run:  # a print without a controller has none
            jetted = (run.pattern[1:] != 0).sum(("x", "y")).values
            draw_line(droplets, number, layer[1:], jetted, drawstyle="steps-mid")
    mean.set_yscale("symlog", linthresh=LINEAR_UM, linscale=0.7)
    mean.yaxis.set_major_locator(FixedLocator(_decades(runs)))
    mean.axhline(0, color="black", linestyle="--", linewidth=0.8)
    if any((run["std"][1:] > 0.0).any() for run in runs.values()):  # not where nothing was printed
        spread.set(yscale="log")
        spread.yaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        spread.yaxis.set_minor_formatter("{x:g}")
    for axes in (mean, spread):
        axes.yaxis.set_major_formatter("{x:g}")
    most = max(int(run.layer[-1]) for run in runs.values())
    for axes in (mean, spread, droplets):
        axes.set_xlim(-0.02 * most - 0.2, 1.02 * most + 0.2)
        axes.grid(color="0.92")
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    droplets.set_ylim(0, None)


def divergence(runs: Runs) -> Figure:
    """Difference between the scans and the shadow's model, layer by layer: of the layer, and of the whole surface.

    A ring stands where the status was untrusted or a fault.
    """
    figure = new_figure(3.8)
    growth, surface = figure.subplots(2, 1, sharex=True)
    for number, (name, run) in enumerate(runs.items()):
        if "growth_divergence" not in run:
            continue
        layer, of_layer = run.layer.values, run.growth_divergence.values * UM_PER_M
        draw_line(growth, number, layer, of_layer, name)
        draw_line(surface, number, layer, run.surface_divergence.values * UM_PER_M)
        alarmed = run.shadow_status.values > 0
        growth.plot(layer[alarmed], of_layer[alarmed], "o", ms=9, mfc="none", mec="black", clip_on=False)
    growth.set(ylabel="of the layer [µm]", ylim=(0, None), title="rms over the part of scan minus the shadow's model")
    growth.legend()
    surface.set(ylabel="of the surface [µm]", xlabel="layer", ylim=(0, None))
    for axes in (growth, surface):
        axes.grid(color="0.92")
        axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    return figure


def _decades(runs: Runs) -> list[float]:
    """Ticks for mean errors [um]: zero, and the powers of ten on either side."""
    found = np.concatenate([run.mean_error.values for run in runs.values()]) * UM_PER_M
    shown: list[float] = [0.0]
    for sign, largest in ((1.0, np.nanmax(found)), (-1.0, -np.nanmin(found))):
        shown += [sign * 10.0**power for power in range(int(np.ceil(np.log10(max(largest, LINEAR_UM)))) + 1)]
    return sorted(shown)

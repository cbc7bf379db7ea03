"""Pictures of the reproduction: published figures in black, computed ones in colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from mpl_toolkits.mplot3d.axes3d import Axes3D

from inkloop.component import FloatMap
from inkloop.report.plot import COLOURS, WIDTH_IN, outside_legend
from inkloop.units import UM_PER_M
from inkloop_lab.models.young_laplace_deposition import FineSurface

MARKS = ("o", "s", "^", "D", "v")


def droplet_errors(
    sizes_um: Sequence[float],
    printed: Mapping[str, Sequence[tuple[float, float, float]]],
    by_triangles: Mapping[str, Sequence[tuple[float, float]]],
    by_kernel: Mapping[str, Sequence[tuple[float, float, float]]],
) -> Figure:
    """Mean and centre error over the size of the elements or the spacing, on logarithmic axes."""
    figure = Figure(figsize=(WIDTH_IN, 3.2), layout="constrained")
    for number, axes in enumerate(figure.subplots(1, 2)):
        for mark, (name, errors) in zip(MARKS, printed.items(), strict=False):
            shown = [error[number] for error in errors]
            axes.plot(sizes_um, shown, ":", color="black", marker=mark, ms=4, mfc="none", label=f"printed: {name}")
        for mark, colour, (name, found) in zip(MARKS, COLOURS, by_triangles.items(), strict=False):
            shown = [error[number] for error in found]
            axes.plot(sizes_um, shown, color=colour, marker=mark, ms=4, label=f"scikit-fem: {name}")
        for mark, (name, ours) in zip(("x", "+"), by_kernel.items(), strict=False):
            spacings, shown = [row[0] for row in ours], [row[1 + number] for row in ours]
            axes.plot(spacings, shown, "--", color=COLOURS[3], marker=mark, label=name)
        axes.set(xscale="log", yscale="log", xlabel="largest element or spacing [µm]")
        axes.set_ylabel(("mean error [µm]", "error of the centre [µm]")[number])
        axes.grid(color="0.92")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.yaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    handles, labels = axes.get_legend_handles_labels()
    outside_legend(figure, handles, labels)
    return figure


def lines_on_a_step(shown: Mapping[str, tuple[FineSurface, FineSurface]]) -> Figure:
    """Five droplets at the edge of a layer: seen from above with the outline, and cut across the edge."""
    figure = Figure(figsize=(WIDTH_IN, 4.2), layout="constrained")
    above, cuts = figure.subplots(2, len(shown), height_ratios=(3, 2))
    for axes, cut, (name, (below, after)) in zip(above, cuts, shown.items(), strict=True):
        fine, added = after.over_grid * UM_PER_M, (after.over_grid - below.over_grid) * UM_PER_M
        size = fine.shape[0] * after.spacing * UM_PER_M
        at = (np.arange(fine.shape[0]) + 0.5) * after.spacing * UM_PER_M
        image = axes.imshow(fine.T, origin="lower", extent=(0, size, 0, size), cmap="viridis")
        axes.contour(at, at, added.T, levels=[0.05], colors="white", linewidths=1.0)
        axes.set_title(name.replace(", ", "\n"))
        axes.set(xlabel="x [µm]")
        middle = fine.shape[0] // 2
        cut.fill_between(at, below.over_grid[middle] * UM_PER_M, color="0.8", linewidth=0)
        cut.plot(at, fine[middle], color=COLOURS[0])
        cut.set(xlabel="y [µm]", ylim=(0, 45))
    above[0].set_ylabel("y [µm]")
    cuts[0].set_ylabel("height in the middle [µm]")
    figure.colorbar(image, ax=list(above), label="height [µm]")
    return figure


def square(surface: FineSurface) -> Figure:
    """The finished square in space."""
    fine = surface.over_grid * UM_PER_M
    x = (np.arange(fine.shape[0]) + 0.5) * surface.spacing * UM_PER_M
    figure = Figure(figsize=(WIDTH_IN, 3.6))
    axes = figure.add_subplot(projection="3d")
    assert isinstance(axes, Axes3D)
    axes.plot_surface(
        x[:, None], x[None, :], fine, cmap="viridis", rcount=230, ccount=230, linewidth=0, antialiased=False
    )
    axes.set_box_aspect((1, 1, 0.25), zoom=1.0)
    axes.zaxis.set_major_locator(MaxNLocator(3))
    axes.set_position((0.0, 0.0, 1.0, 1.0))
    axes.set(xlabel="along the lines [µm]", ylabel="across [µm]", zlabel="height [µm]")
    axes.view_init(elev=28, azim=-55)
    return figure


def square_walls(profiles: Mapping[str, tuple[FloatMap, FloatMap, float]]) -> Figure:
    """End and side walls as measured by a profiler, to scale; dotted the nominal part of ten even layers."""
    figure = Figure(figsize=(WIDTH_IN, 2.9), layout="constrained")
    for number, axes in enumerate(figure.subplots(2, 1, sharex=True)):
        for colour, (name, shown) in zip(COLOURS, profiles.items(), strict=False):
            profile, spacing = shown[:2][number], shown[2] * UM_PER_M
            axes.plot((np.arange(len(profile)) + 0.5) * spacing, profile, color=colour, label=name)
        axes.plot([84.6, 84.6, 1142.1, 1142.1], [0, 167.7, 167.7, 0], color="black", linestyle=":", label="nominal")
        axes.set(aspect="equal", ylim=(0, 240), ylabel=("along lines [µm]", "across [µm]")[number])
    axes.set_xlabel("[µm]")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def growth(line: Sequence[FloatMap], dome: FloatMap, added: FloatMap, tower: FloatMap) -> Figure:
    """A line layer by layer, the cuboid of four layers by two models, and a cut of the cylinder of ten layers [µm]."""
    figure = Figure(figsize=(WIDTH_IN, 2.6), layout="constrained")
    lines, cuboid, cylinder = figure.subplots(1, 3)
    for surface in line:
        lines.plot(surface, marker=".", ms=3, color=COLOURS[0], linewidth=0.8)
    lines.set(title="a line, layers 1 to 6", xlabel="droplet", ylabel="height [µm]")
    cuboid.plot(dome, marker=".", color=COLOURS[0], label="layer-to-layer model")
    cuboid.plot(added, marker=".", color=COLOURS[1], label="traditional model")
    cuboid.set(title="cuboid, four layers: middle row", xlabel="droplet", ylim=(0, None))
    cuboid.legend(loc="lower center")
    cylinder.plot(tower, marker=".", ms=3, color=COLOURS[0])
    cylinder.set(title="cylinder, ten layers: cut", xlabel="cell", ylim=(0, None))
    return figure


def spacing(found: Sequence[tuple[float, float, float]], chosen: float) -> Figure:
    """Unevenness of a layer and its lowest place over its highest, by the spacing factor."""
    figure = Figure(figsize=(WIDTH_IN * 0.6, 2.6), layout="constrained")
    axes = figure.subplots()
    gamma, uneven, dip = (np.array(column) for column in zip(*found, strict=True))
    axes.plot(gamma, uneven, marker="o", ms=4, color=COLOURS[0], label="unevenness (std / mean)")
    axes.plot(gamma, dip, marker="s", ms=4, color=COLOURS[1], label="lowest / highest")
    axes.axvline(chosen, color="black", linestyle=":", label="the paper's choice")
    axes.set(xlabel="spacing / droplet diameter", ylabel="%", ylim=(0, None))
    axes.legend()
    axes.grid(color="0.92")
    return figure


def pattern_errors(printed: Mapping[str, float], found: Mapping[str, Mapping[str, tuple[float, float]]]) -> Figure:
    """Relative rms error of the predicted cells by the number of prior drops [%], with its scatter over the groups."""
    figure = Figure(figsize=(WIDTH_IN * 0.75, 2.6), layout="constrained")
    axes = figure.subplots()
    at, width = np.arange(len(printed)), 0.27
    axes.bar(at - width, list(printed.values()), width, color="black", label="printed, their ink")
    for number, (colour, (name, rms)) in enumerate(zip(COLOURS, found.items(), strict=False)):
        means, scatter = np.array([rms[prior] for prior in printed]).T * 100.0
        axes.bar(at + number * width, means, width, yerr=scatter, color=colour, label=name, error_kw={"lw": 0.8})
    axes.set_xticks(at, list(printed))
    axes.set(xlabel="prior drops", ylabel="rms error (21) [%]")
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    return figure

"""Picture of the residuals of the models: place, size, and step height of the surface."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from inkloop.report import plot
from inkloop.report.plot import WIDTH_IN
from inkloop.units import UM_PER_M
from inkloop_lab.identify.identification import Comparison, Identification

SHOWN = 4  # number of models shown, the best ones
BINS = 60
THIN = {"linewidth": 1.0}
QUANTILES = 16
RESIDUAL, RESIDUAL_SIGN = "scan minus prediction", "scan higher +, lower -"
LEAST = 30  # least number of growths in a bin


def save(found: Identification, path: Path, formats: Sequence[str]) -> list[Path]:
    """Write the picture, `path` with the suffix of each format; the files."""
    with rc_context(plot.STYLE):
        return plot.save(residuals(found), path, formats) if formats else []


def residuals(found: Identification) -> Figure:
    """Residuals of cells left out of the fit: of the best model by cell, of the best ones as densities, and their means
    by the height of the cell above its sides.
    """
    shown = sorted((c for c in found.comparisons if c.score), key=_rms)[:SHOWN]
    figure = Figure(figsize=(WIDTH_IN, 2.7), layout="constrained")
    by_cell, densities, by_rise = figure.subplots(1, 3)
    _map(figure, by_cell, shown[0])
    _densities(densities, shown, found.noise_std)
    _by_rise(by_rise, shown, found)
    handles, labels = densities.get_legend_handles_labels()
    plot.outside_legend(figure, handles, labels)
    return figure


def _map(figure: Figure, axes: Axes, best: Comparison) -> None:
    errors = max(best.errors, key=np.size)
    seen = np.isfinite(errors).any(axis=0)
    rms = np.sqrt(np.nanmean(np.where(seen, errors, 0.0) ** 2, axis=0)) * UM_PER_M
    image = axes.imshow(np.where(seen, rms, np.nan).T, origin="lower", cmap="viridis", vmin=0.0)
    figure.colorbar(image, ax=axes, label="rms over the layers [µm]", shrink=0.9)
    axes.set(title=best.name, xlabel="cell along x", ylabel="cell along y")


def _densities(axes: Axes, shown: Sequence[Comparison], noise_std: float) -> None:
    errors = [_flat(comparison) * UM_PER_M for comparison in shown]
    limit = float(max(np.quantile(np.abs(error), 0.99) for error in errors))
    for error, comparison, line in zip(errors, shown, plot.LINES, strict=False):
        density, edges = np.histogram(error, BINS, (-limit, limit), density=True)
        axes.stairs(density, edges, label=comparison.name, **line | THIN)
    if noise_std > 0.0:
        x, spread = np.linspace(-limit, limit, 300), np.sqrt(2.0) * noise_std * UM_PER_M
        normal = np.exp(-0.5 * (x / spread) ** 2) / (spread * np.sqrt(2.0 * np.pi))
        axes.plot(x, normal, color="0.4", linewidth=0.8, linestyle="--", label="noise of two scans")
    axes.set(title="residuals", xlabel=f"{RESIDUAL} [µm]\n({RESIDUAL_SIGN})", ylabel="density [1/µm]")


def _by_rise(axes: Axes, shown: Sequence[Comparison], found: Identification) -> None:
    """Residuals by predicted steps, whose errors are independent of the scan that the prediction began from."""
    parts = zip(found.compared, shown[0].errors, strict=True)
    rise = np.concatenate([_rises(record.measured[1:] - error)[:-1].ravel() for record, error in parts]) * UM_PER_M
    if rise.size == 0:
        axes.set_axis_off()
        return
    for comparison, line, mark in zip(shown, plot.LINES, plot.MARKS, strict=False):
        error = np.concatenate([part[1:].ravel() for part in comparison.errors]) * UM_PER_M
        known = np.isfinite(error) & np.isfinite(rise)
        edges = np.unique(np.quantile(rise[known], np.linspace(0.0, 1.0, QUANTILES + 1)))
        place = np.clip(np.searchsorted(edges, rise[known], "right") - 1, 0, len(edges) - 2)
        count = np.bincount(place, minlength=len(edges) - 1)
        enough = count >= LEAST
        of_rise, of_error = (np.bincount(place, v[known], len(edges) - 1) / np.maximum(count, 1) for v in (rise, error))
        axes.plot(of_rise[enough], of_error[enough], marker=mark, markersize=3, **line | THIN)
    axes.axhline(0.0, color="0.7", linewidth=0.6)
    axes.set(title="mean by the step of a cell", xlabel="height above its sides [µm]", ylabel=f"{RESIDUAL} [µm]")


def _rises(surface: NDArray[np.float64]) -> NDArray[np.float64]:
    """(layers, nx, ny): each cell's height less the mean of its four sides; NaN at the border."""
    found = np.full(surface.shape, np.nan)
    sides = surface[:, :-2, 1:-1] + surface[:, 2:, 1:-1] + surface[:, 1:-1, :-2] + surface[:, 1:-1, 2:]
    found[:, 1:-1, 1:-1] = surface[:, 1:-1, 1:-1] - sides / 4.0
    return found


def _flat(comparison: Comparison) -> NDArray[np.float64]:
    errors = np.concatenate([part.ravel() for part in comparison.errors])
    return np.asarray(errors[np.isfinite(errors)])


def _rms(comparison: Comparison) -> float:
    return comparison.score.rms if comparison.score else np.inf

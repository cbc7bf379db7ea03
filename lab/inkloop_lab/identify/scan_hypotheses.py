"""Tests whether the scans of a log show its patterns: as recorded, in another orientation of the grid, or a layer
apart.

A droplet adds height near it only. The growth from scan to scan is regressed on all droplets up to three cells away,
with a free datum of each growth. The explained share of the growth distinguishes the hypotheses for any ink, plant, or
shift of the scans (`scan_geometry`); the shift is the centre of the regression's weights. The observer tests each scan
in the same way during a print (`controller/core/observer/scan_doubts.c`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import convolve

from inkloop_lab.identify.print_record import IdentificationError, PrintRecord

REACH = 3  # cells along each side of a droplet
SIDE = 2 * REACH + 1
DATUM = 6  # offset, tilt and bow of a scan
LAYERS_MOST, CELLS_MOST = 40, 20_000  # largest numbers of layers and cells used, at even distances
CLEARLY = 0.1  # share of the growth that another hypothesis must explain in addition (assumed)
OF_DROPLETS = 0.4  # least share of the growth explained by droplets (assumed)
STILL = 0.25  # share of the height added in other layers, below which nothing grew (assumed)
CERTAIN = 3.0  # standard errors
NAMED = 5  # layers named in a message
NOMINAL = np.array([[0.2, 0.6, 0.2], [0.6, 4.4, 0.6], [0.2, 0.6, 0.2]]) / 7.6
"""Shares of a droplet by cell, to test that the scans show droplets: Lu et al. 2015, Table I."""

TURNS: Mapping[str, tuple[Callable[[Any], Any], str]] = {
    "mirrored in x": (lambda m: m[::-1], 'set mirror = "x"'),
    "mirrored in y": (lambda m: m[:, ::-1], 'set mirror = "y"'),
    "turned by 180 degrees": (lambda m: m[::-1, ::-1], "add 180 to rotation_deg"),
    "transposed": (lambda m: m.T, 'set mirror = "y", add 90 to rotation_deg'),
    "turned by 90 degrees": (lambda m: np.rot90(m, 1), "add 90 to rotation_deg"),
    "turned by 270 degrees": (lambda m: np.rot90(m, 3), "add 270 to rotation_deg"),
    "transposed and turned by 180 degrees": (lambda m: m[::-1, ::-1].T, 'set mirror = "x", add 90 to rotation_deg'),
}
"""Orientations of scans: the transform to the printer, and the keys of print.toml for it. Those from "transposed" on
take a square grid."""
LAGS: Mapping[str, tuple[int, str]] = {
    "one layer late": (1, "number the map after layer n by n, not by n + 1"),
    "one layer early": (-1, "number the map after layer n by n, not by n - 1, the start surface by 0"),
}


@dataclass(frozen=True, eq=False)
class Explained:
    """share: of the growth explained by the droplets of a hypothesis, adjusted for the number of weights; weights:
    (materials, 7, 7) height added by a droplet so many cells away along x and y [m].
    """

    share: float
    weights: NDArray[np.float64]


def first_shift(record: PrintRecord) -> NDArray[np.float64]:
    """(2,) shift of the scans along x and y by the growth, to a few tenths [cells]; 0 if it shows none.

    Raises IdentificationError if the scans do not show the patterns of the log: they are turned, a layer apart, did not
    grow, or show something else.
    """
    read = _explained(record, record.measured) if record.pattern.any() else None
    if read is None:
        return np.zeros(2)
    problem = _turned(record, read) or _still(record, read) or _unrelated(record, read)
    if problem:
        raise IdentificationError(f"{record.name}: {problem}")
    weights = np.maximum(read.weights.sum(axis=0), 0.0)
    i, j = np.unravel_index(int(np.argmax(weights)), weights.shape)
    near = np.zeros_like(weights)
    near[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2] = weights[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2]
    along_x, along_y = np.indices(near.shape) - REACH
    total = float(near.sum())
    return np.array([(near * along_x).sum(), (near * along_y).sum()]) / total if total > 0.0 else np.zeros(2)


def _turned(record: PrintRecord, read: Explained) -> str:
    """Another orientation or order of the scans that explains them clearly better; empty if there is none."""
    found: list[tuple[float, str, str]] = []
    is_square = record.shape[0] == record.shape[1]
    for name, (turn, remedy) in TURNS.items():
        turned = [turn(scan) for scan in record.measured]
        other = _explained(record, np.stack(turned)) if is_square or turned[0].shape == record.shape else None
        if other is not None:
            found.append((other.share, f"are {name}", f"{remedy} in its print.toml and correct the offsets"))
    for name, (lag, remedy) in LAGS.items():
        other = _explained(record, record.measured, lag)
        if other is not None:
            found.append((other.share, f"come {name}", remedy))
    share, name, remedy = max(found)
    if share <= read.share + CLEARLY:
        return ""
    return (
        f"the scans {name}: so the droplets explain {share:.0%} of the growth, as recorded {max(read.share, 0.0):.0%}; "
        f"{remedy}, or set the profiler of the run right and print again"
    )


def _still(record: PrintRecord, read: Explained) -> str:
    """Layers whose droplets the scans do not show, while those of others are shown; empty if there are none."""
    if not np.nan_to_num(np.diff(record.measured, axis=0)).any():
        return "all scans are the same, though droplets were jetted; log the scan after each layer"
    shown = {}
    for layer, own, grown in _growths(record, record.measured):
        expected = own @ read.weights.ravel()
        size = float(expected @ expected)
        if size > 0.0:
            error = np.sqrt(float(grown @ grown) / grown.size / size)
            shown[layer] = float(expected @ grown) / size, float(error)
    usual = float(np.quantile([share for share, _ in shown.values()], 0.9)) if shown else 0.0
    still = [layer for layer, (share, error) in shown.items() if share + CERTAIN * error < STILL * usual]
    if not still:
        return ""
    share = max(shown[still[0]][0] / usual, 0.0)
    named = ", ".join([*map(str, still[:NAMED]), *["..."] * (len(still) > NAMED)])
    return (
        f"the scans do not grow in layer {named}: the droplets of layer {still[0]} show {share:.0%} of what those of "
        "other layers show; log the scan after each layer, check that the head has printed, or leave out these layers"
    )


def _unrelated(record: PrintRecord, read: Explained) -> str:
    """Growth that differs from layer to layer in another way than the droplets do; empty if it is theirs."""
    is_varied = len(record.pattern) > 1
    growth, added = np.diff(record.measured, axis=0), _added(record)
    measured = record.measured
    if is_varied:
        growth, added = _less_mean(growth), _less_mean(added)
        measured = np.concatenate([np.zeros((1, *record.shape)), np.cumsum(growth, axis=0)])
    found = _explained(record, measured, is_varied=is_varied) or read
    total, must, cells = 0.0, 0.0, 0
    for one, own in zip(growth, added, strict=True):
        seen = np.isfinite(one)
        if seen.any():
            total, must = total + float(np.var(one[seen])) * seen.sum(), must + float(np.var(own[seen])) * seen.sum()
            cells += int(seen.sum())
    chance = CERTAIN * np.sqrt(2.0 * read.weights.size) / max(cells, 1)
    share, must = (found.share, min(must / total, 1.0)) if must > chance * total else (read.share, 0.0)
    if read.share > chance and share >= OF_DROPLETS * must:
        return ""
    return (
        f"its patterns explain {max(share, 0.0):.0%} of how the scans grow, and no other orientation or order of the "
        "scans explains more; log the patterns and the scans of the same print"
    )


def _less_mean(maps: NDArray[np.float64]) -> NDArray[np.float64]:
    """(layers, nx, ny) less the mean of each cell over the layers."""
    seen = np.isfinite(maps)
    return np.asarray(maps - np.where(seen, maps, 0.0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1))


def _added(record: PrintRecord) -> NDArray[np.float64]:
    """(layers, nx, ny): height added by droplets of the mean volume of the log [m]."""
    growth = float(np.nansum(np.diff(record.measured, axis=0)))
    volume = max(growth, 0.0) / max(int(np.count_nonzero(record.pattern)), 1)
    return np.asarray(convolve(volume * (record.pattern > 0), NOMINAL[None], mode="constant"))


def _explained(
    record: PrintRecord, measured: NDArray[np.float64], lag: int = 0, is_varied: bool = False
) -> Explained | None:
    """Explained share of the growth in scans (layers + 1, nx, ny) by the droplets of a print; None: too few
    readings.
    """
    count = record.materials * SIDE**2
    matrix, side, total, used = np.zeros((count, count)), np.zeros(count), 0.0, 0
    for _, own, grown in _growths(record, measured, lag, is_varied):
        matrix += own.T @ own
        side += own.T @ grown
        total += float(grown @ grown)
        used += grown.size - DATUM
    if used < 2 * count:
        return None
    weights = np.asarray(np.linalg.lstsq(matrix, side, rcond=1e-9)[0], np.float64)
    unexplained = (total - float(weights @ side)) / (used - count)
    share = 1.0 - unexplained / (total / used) if total > 0.0 else 0.0
    return Explained(share, weights.reshape(record.materials, SIDE, SIDE))


def _growths(
    record: PrintRecord, measured: NDArray[np.float64], lag: int = 0, is_varied: bool = False
) -> Iterator[tuple[int, NDArray[np.float64], NDArray[np.float64]]]:
    """Number of a layer, (cells, weights) droplets around each cell, and (cells,) its growth [m], both less their
    datum.

    lag: layers by which the scans are late; is_varied: patterns less their mean over the layers.
    """
    layers, (nx, ny) = len(record.pattern), record.shape
    inks = np.arange(1, record.materials + 1)[:, None, None]
    usual = np.stack([(record.pattern == ink).mean(axis=0) for ink in inks]) if is_varied else 0.0
    u, w = (each.ravel() for each in np.meshgrid(np.linspace(-1, 1, nx), np.linspace(-1, 1, ny), indexing="ij"))
    terms = np.stack([np.ones(u.size), u, w, u * u, u * w, w * w], axis=1)
    numbers = range(max(0, lag), min(layers, layers + lag))
    for k in numbers[:: len(numbers) // LAYERS_MOST + 1]:
        growth = (measured[k + 1] - measured[k]).ravel()
        cells = np.nonzero(np.isfinite(growth))[0]
        cells = cells[:: cells.size // CELLS_MOST + 1]
        if cells.size < 2 * DATUM:
            continue
        drops = np.pad((record.pattern[k - lag] == inks) - usual, ((0, 0), (REACH, REACH), (REACH, REACH)))
        around = sliding_window_view(drops, (SIDE, SIDE), axis=(1, 2))[:, cells // ny, cells % ny]
        both = np.column_stack([around.transpose(1, 0, 2, 3).reshape(cells.size, -1), growth[cells]])
        basis = np.linalg.qr(terms[cells])[0]
        both -= basis @ (basis.T @ both)
        yield k + 1, both[:, :-1], both[:, -1]

"""Tables, figures and picture of identify-an-ink.md."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table
from tools.figures.pages import DOCS, ROOT, Texts, read_json, table, write_json

from inkloop.printing.print import Print
from inkloop.report.formats import PNG
from inkloop.scenario.file import Scenario
from inkloop.units import M_PER_UM, UM_PER_M
from inkloop_lab.identify import designs
from inkloop_lab.identify.command import tables
from inkloop_lab.identify.experiments import Plan, perform, plant_scenario
from inkloop_lab.identify.identification import identify
from inkloop_lab.identify.ink_regression import identify_ink
from inkloop_lab.identify.picture import save
from inkloop_lab.identify.print_record import PrintRecord, noise_of
from inkloop_lab.identify.run_record import record_of
from inkloop_lab.identify.scan_geometry import ScanGeometry
from inkloop_lab.identify.scan_registration import register
from inkloop_lab.identify.volume_area_coefficients import (
    GROUP,
    LEVEL,
    TWO_PRIOR,
    drop_samples,
    height_differences,
)
from inkloop_lab.models import DropletVolumes, LayerDeposition, VolumeAreaDeposition

HERE = DOCS / "how-to"
PAGE = HERE / "identify-an-ink.md"
RECORD = PAGE.with_suffix(".json")
PITCH = 263.256e-6
PRINTS = 20
SEEDS_DISPLACED, SHAPE_DISPLACED = 5, (40, 34)
_TURN = float(np.radians(1.0))
DISPLACED = {
    "in register": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "shift 0.25 cells along x": (0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "shift 0.25 along x, -0.25 along y": (0.25, -0.25, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    "shift that drifts by 0.5 along x": (0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.0),
    "rotation 1 degree": (0.0, 0.0, 0.0, -_TURN, _TURN, 0.0, 0.0, 0.0),
    "magnification 2 %": (0.0, 0.0, 0.02, 0.0, 0.0, 0.02, 0.0, 0.0),
    "all together": (0.25, -0.25, 0.02, -_TURN, _TURN, 0.02, 0.1, 0.1),
}
GAINS = ("mv_plus", "mv_minus", "ma_minus")
"""Of Wu and Chiu; the paper's ma_plus is 0."""


def print_of(patterns: list[NDArray[np.int32]], noise: float, seed: int, variation: float = 0.0) -> PrintRecord:
    """Layers of the ink of Lu et al. as a profiler with white noise [m] sees them."""
    model = LayerDeposition()
    surfaces = [model.start(np.zeros(patterns[0].shape))]
    for number, pattern in enumerate(patterns, start=1):
        nx, ny = pattern.shape
        volume = DropletVolumes(variation, seed=seed).of_layer(nx, ny, number)
        surfaces.append(model.layer(surfaces[-1], pattern, number, volume))
    scans = np.stack([surface.height for surface in surfaces])
    return PrintRecord(
        "made up", PITCH, np.stack(patterns), scans + np.random.default_rng(seed).normal(0, noise, scans.shape)
    )


def bias() -> Iterator[list[str]]:
    """What noise does to a plain regression and to ours, over prints that differ in noise and patterns."""
    cases = [("one layer, 20 x 20 cells", 20, 1, 0.3e-6), ("5 layers, 40 x 40 cells", 40, 5, 1e-6)]
    for label, side, count, noise in cases:
        records = [print_of(designs.layers(side, side, count, seed, margin=1), noise, seed) for seed in range(PRINTS)]
        for method, correct in (("plain", False), ("this page", True)):
            found = np.array([identify_ink([one], noise, correct=correct).heights[0] for one in records])
            error = (found / LayerDeposition().heights[0] - 1.0) * 100
            means, worst = error.mean(axis=0), np.abs(error).max(axis=0)
            figures = (f"{m:+.1f} ({w:.1f}) %" for m, w in zip(means, worst, strict=True))
            yield [label, f"{noise * UM_PER_M:g} µm", method, *figures]


def displaced() -> Iterator[list[str]]:
    """What displaced scans do to the ink, with and without their geometry, over prints that differ in noise and
    patterns.
    """
    for label, terms in DISPLACED.items():
        errors: dict[str, list[NDArray[np.float64]]] = {"as recorded": [], "registered": []}
        for seed in range(SEEDS_DISPLACED):
            record = displaced_print(np.array(terms), seed)
            placed = register(record, 1.0 * M_PER_UM).geometry
            for way, geometries in (("as recorded", None), ("registered", [placed])):
                found = identify_ink([record], 1.0 * M_PER_UM, geometries=geometries).heights[0]
                errors[way].append((found / LayerDeposition().heights[0] - 1.0) * 100)
        for way, each in errors.items():
            means, worst = np.mean(each, axis=0), np.abs(each).max(axis=0)
            yield [label, way, *(f"{m:+.1f} ({w:.1f}) %" for m, w in zip(means, worst, strict=True))]


def displaced_print(terms: NDArray[np.float64], seed: int) -> PrintRecord:
    """Twelve layers on 40 x 34 cells; terms: shift along x and y [cells], linear part (4) [1], and drift along x and y
    over the print [cells].
    """
    record = print_of(designs.layers(*SHAPE_DISPLACED, 12, seed, margin=4), 0.0, seed)
    half = 0.5 * (np.array(SHAPE_DISPLACED) - 1.0)
    placed = np.concatenate([terms[:2], terms[2:6] * np.tile(half, 2), 0.5 * terms[6:]])
    geometry = ScanGeometry(SHAPE_DISPLACED, 12, placed)
    scans = np.stack(
        [(geometry.sampling(k) @ scan.ravel()).reshape(scan.shape) for k, scan in enumerate(record.measured)]
    )
    noise = np.random.default_rng(seed).normal(0.0, 1.0 * M_PER_UM, scans.shape)
    return PrintRecord(record.name, record.pitch, record.pattern, scans + noise)


def coverage() -> str:
    """In how many prints the 95 % intervals hold the mean ink, with droplets that lack up to 20 % of their volume."""
    true = 0.9 * np.array(LayerDeposition().heights[0])
    inside = []
    for seed in range(2 * PRINTS):
        record = print_of(designs.layers(24, 24, 4, seed, margin=0), 0.5e-6, seed, variation=0.2)
        found = identify_ink([record], 0.5e-6)
        inside.append(np.abs(found.heights[0] - true) <= found.half_widths[0])
    return f"{100 * np.mean(inside):.0f} %"


def shown(found: Table) -> list[list[str]]:
    """Heads and rows of a table of the screen."""
    columns = [[str(column.header).replace("\\[", "["), *map(str, column.cells)] for column in found.columns]
    return [list(line) for line in zip(*columns, strict=True)]


def plant() -> dict[str, Any]:
    """The tables of a plant that none of the droplet models describes; draws the picture."""
    found = identify(perform(plant_scenario("YoungLaplaceDeposition", 0.1, {"grid.pitch_um": 42.3}), Plan()))
    first, *_, last = (shown(one) for one in tables(found))
    first[0][1:] = [f"{height} [µm]" for height in first[0][1:]]
    save(found, HERE / "identified-ink.png", [PNG])
    return {"heights": first, "models": last}


def closed_loop() -> str:
    """What the closed loop of noisy-sensor.toml identifies."""
    record = record_of(Print(Scenario.load(ROOT / "scenarios" / "noisy-sensor.toml")).run(), "noisy-sensor")
    noise = noise_of([record])
    assert noise, "its scans are noisy"
    found = identify_ink([record], noise)
    first, second, third = (
        f"{height * UM_PER_M:.3f} +- {width * UM_PER_M:.3f}"
        for height, width in zip(found.heights[0], found.half_widths[0], strict=True)
    )
    return f"{first}, {second} and {third} µm"


def gains() -> Iterator[list[str]]:
    """Errors of Wu and Chiu's coefficients, by three ways to find them in the same noisy prints."""
    noise_um = 0.04
    records = perform(plant_scenario("VolumeAreaDeposition", noise_um, {"grid.pitch_um": 90.0}), Plan())
    found = identify(records, noise_std=noise_um * M_PER_UM)
    assert found.volume_area
    fitted = {each.name: each.model for each in found.comparisons}["Wu, Chiu, fitted"]
    ways = {
        "plain means of the ratios": plain_means(records, noise_um * M_PER_UM),
        "with weights": found.volume_area.coefficients,
        "fitted to all layers": {name: getattr(fitted, name) for name in GAINS},
    }
    yield ["coefficients", *GAINS]
    for way, coefficients in ways.items():
        yield [way, *(f"{coefficients[name] / getattr(VolumeAreaDeposition, name) - 1.0:+.1%}" for name in GAINS)]


def plain_means(records: Sequence[PrintRecord], noise: float) -> dict[str, float]:
    """(17) as the paper takes it, next to two prior drops: the mean of gain over height difference of the cells that
    `identify` counts too; by name [1/m]."""
    samples = drop_samples(records, noise)
    scale = float(np.mean([np.sum(each.height_after - each.height) for each in samples]))
    level = max(LEVEL * scale, 3.0 * noise)
    chosen = [each for each in samples if each.prior == TWO_PRIOR]
    ratios: dict[str, list[float]] = {name: [] for name in GAINS}
    for at in range(0, len(chosen) - GROUP + 1, GROUP):
        before, after, area, area_after = (
            np.mean([getattr(each, name) for each in chosen[at : at + GROUP]], axis=0)
            for name in ("height", "height_after", "area", "area_after")
        )
        difference = height_differences(np.divide(before, area, out=np.zeros_like(before), where=area > 0.0))
        difference[1, 1] = 0.0
        for name, gain, sign in zip(
            GAINS, ((after - before) / scale, (after - before) / scale, area_after - area), (1, -1, -1), strict=True
        ):
            cells = sign * difference > level
            ratios[name] += list(gain[cells] / difference[cells])
    return {name: float(np.mean(each)) for name, each in ratios.items()}


PARTS: dict[str, Callable[[], dict[str, Any]]] = {
    "noise": lambda: {"noise": [["print", "noise", "method", "h1", "h2", "h3"], *bias()]},
    "displaced": lambda: {"displaced": [["scans, noise 1 µm", "taken", "h1", "h2", "h3"], *displaced()]},
    "coverage": lambda: {"coverage": coverage()},
    "plant": plant,
    "closed loop": lambda: {"closed loop": closed_loop()},
    "gains": lambda: {"gains": [*gains()]},
}


def run(*parts: str) -> None:
    """Keep the tables, or those of these parts, and draw the picture."""
    record = read_json(RECORD)
    for part in parts or PARTS:
        record |= PARTS[part]()
    write_json(RECORD, record)


def texts() -> Texts:
    """The tables, and the figures in the text."""
    record = read_json(RECORD)
    return {PAGE: {name: found if isinstance(found, str) else table(*_parts(found)) for name, found in record.items()}}


def _parts(lines: Sequence[Sequence[str]]) -> tuple[Sequence[str], Sequence[Sequence[str]]]:
    return lines[0], lines[1:]

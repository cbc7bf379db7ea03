"""Prints made up for identification: what was jetted by known models, and what a noisy profiler saw of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inkloop_lab.identify.print_record import PrintRecord
from inkloop_lab.models import DropletVolumes

PITCH = 263.256e-6
CELL = "pitch_um = 263.256\nunit = 'um'\npixel_um = 263.256\n"


def made_up(
    model: Any, patterns: Sequence[Any], noise: float = 0.0, seed: int = 0, variation: float = 0.0, start: Any = None
) -> PrintRecord:
    """The record of a print with `model` from `start` (flat), scanned with white noise [m]."""
    generator = np.random.default_rng(seed)
    shape = patterns[0].shape
    surface = model.start(np.zeros(shape) if start is None else start)
    surfaces = [surface]
    volumes = DropletVolumes(variation, seed=seed)
    for number, pattern in enumerate(patterns, start=1):
        surfaces.append(model.layer(surfaces[-1], pattern, number, volumes.of_layer(*shape, number)))  # type: ignore[call-arg]
    measured = np.stack([one.height for one in surfaces]) + generator.normal(0.0, noise, (len(surfaces), *shape))
    area = np.stack([one.area for one in surfaces]) if hasattr(surface, "area") else None
    process = [getattr(model, name, 1) for name in ("passes", "pass_order")]
    pattern = np.stack(patterns).astype(np.int32)
    pitch = getattr(model, "pitch", PITCH)
    return PrintRecord("made up", pitch, pattern, measured, area, *process, getattr(model, "pass_rotation", 0))  # type: ignore[call-arg]


def random_layers(nx: int, ny: int, count: int, seed: int, margin: int = 0) -> list[Any]:
    """Layers of half the cells."""
    generator = np.random.default_rng(1000 + seed)
    found = [(generator.random((nx, ny)) < 0.5).astype(np.int32) for _ in range(count)]
    for pattern in found:
        if margin:
            pattern[:margin] = pattern[-margin:] = 0
            pattern[:, :margin] = pattern[:, -margin:] = 0
    return found


def log(folder: Path, record: PrintRecord, description: str = CELL, pixels: int = 1) -> Path:
    """A folder as a user would log it: tables whose rows go along x, heights in um."""
    folder.mkdir(exist_ok=True)
    (folder / "print.toml").write_text(description)
    for layer, pattern in enumerate(record.pattern, start=1):
        np.savetxt(folder / f"pattern_{layer:04d}.csv", pattern.T, fmt="%d", delimiter=",")
    for layer, scan in enumerate(record.measured):
        fine = np.kron(scan, np.ones((pixels, pixels)))
        np.savetxt(folder / f"layer_{layer:04d}.csv", fine.T * 1e6, fmt="%.9f", delimiter=",")
    return folder

"""Prints in memory: any controller of the layer contract, the layer map as plant, an exact sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from inkloop.component import Component, Job, Status
from inkloop_controller.model import LayerModel

SECOND = 1_000_000_000


@dataclass(frozen=True)
class Print:
    """Result of a print: surface [m] and patterns, and the controller's last outputs."""

    height: Any
    patterns: list[Any]
    outputs: dict[str, Any]

    def errors_um(self, job: Job) -> tuple[float, float, float]:
        """Mean error (target minus height), mean absolute error and std over the part [um]."""
        error = (job.target_height - self.height)[job.mask] * 1e6
        return float(error.mean()), float(np.abs(error).mean()), float(error.std())


def cylinder(height: float = 400e-6) -> Job:
    """709 cells on a grid of 35 x 35, `height` [m] as in Fig. 11 of Lu, Zheng, Mishra (2015) if not given."""
    i, j = np.indices((35, 35))
    mask = (i - 17) ** 2 + (j - 17) ** 2 <= 225
    return Job(35, 35, 263.256e-6, np.where(mask, height, 0.0), mask)


def block(nx: int = 10, ny: int = 9, height: float = 30e-6, **fields: Any) -> Job:
    """A block with a margin of two cells."""
    mask = np.zeros((nx, ny), np.bool_)
    mask[2:-2, 2:-2] = True
    return Job(nx, ny, 263.256e-6, np.where(mask, height, 0.0), mask, **fields)


def inputs_of(job: Job, height: Any, layer: int, valid: Any = None) -> dict[str, Any]:
    """The controller's inputs when `layer` is printed and scanned."""
    return {
        "measured_height": height,
        "valid": np.ones((job.nx, job.ny), np.bool_) if valid is None else valid,
        "layers_scanned": np.asarray(layer, np.int32),
        "layers_printed": np.asarray(layer, np.int32),
    }


def print_part(
    controller: Component,
    job: Job,
    *,
    variation: float = 0.0,
    seed: int = 0,
    layers_max: int = 200,
    scan: Callable[[Any, int], Any] = lambda height, layer: height,
) -> Print:
    """Print until the controller is done; every droplet lacks up to `variation` of its volume, at random.

    scan: the reading of a surface after a number of layers; exact if not given.
    """
    plant, rng = LayerModel.of(job), np.random.default_rng(seed)
    height, patterns = np.zeros((job.nx, job.ny)), list[Any]()
    controller.initialize(0, inputs_of(job, scan(height, 0), 0))
    for layer in range(layers_max + 1):
        outputs = dict(controller.do_step(layer * SECOND, SECOND, inputs_of(job, scan(height, layer), layer)))
        if outputs["status"] == Status.DONE:
            return Print(height, patterns, outputs)
        assert outputs["layer_command"] == layer + 1
        patterns.append(outputs["pattern"])
        factor = outputs.get("drop_level", 1) * (1.0 - variation * rng.random(height.shape))
        height = plant.layer(height, outputs["pattern"], layer + 1, factor)
    raise AssertionError(f"not done after {layers_max} layers: mean height {height[job.mask].mean() * 1e6:.1f} um")

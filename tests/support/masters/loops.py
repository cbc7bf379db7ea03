"""A print of 6 x 6 cells and five layers for masters of others: the loop of three FMUs, and one block with scalars."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.exchange import layer_job
from inkloop.exchange.ssp.system import Part, System, system_of
from inkloop.fmu import describe
from inkloop.printing.print import Print
from inkloop.scenario.file import Scenario

JOB = "job"
LAYERS = 5
STEPS_S = (0.7, 1.0, 5.0)
TIME_MAX_S = 120.0
TEXT = f"""
title = "six by six"
seed = 5
grid = {{ nx = 6, ny = 6 }}
part = {{ shape = "cuboid", height_um = 30.0, size_x_um = 1100.0, size_y_um = 1100.0 }}
[components.controller]
kind = "LayerController"
horizon = 2
[components.printer]
kind = "LayerDeposition"
variation = 0.2
layer_duration_s = 2.0
[components.profiler]
kind = "ProfileSensor"
noise_std_um = 0.2
scan_duration_s = 3.0
[run]
layers_max = {LAYERS}
"""
"""Droplets vary, scans are noisy, and both take time: a master that loses or doubles a layer prints another part."""


@dataclass(frozen=True)
class Loop:
    """A system of FMUs, and which ports of which part show the layers that it prints."""

    name: str
    part: str
    ports: tuple[str, ...]
    system_of: Callable[[Scenario, str, Path], System]

    def scalars(self, system: System) -> Sequence[str]:
        """The ports as a tool without arrays names them."""
        return [scalar for port in self.ports for scalar in system.part(self.part).scalars(port)]

    def layers_of(self, run: Any) -> Any:
        """Values of the ports in a run of ours, (layers, numbers)."""
        return np.column_stack([run[port].values[1:].reshape(run.sizes["layer"] - 1, -1) for port in self.ports])


def _block(scenario: Scenario, fmi: str, folder: Path) -> System:
    """A system of one part, which nothing is connected to."""
    baked = layer_job.bake(scenario)
    file = folder / f"{JOB}.fmu"
    layer_job.write(baked, "2" if fmi == "2" else "3", file)
    step_s = scenario.tables.run.step_s
    return System(
        JOB, baked.title, [Part(JOB, file, describe(file), {})], [], {}, step_s, baked.stop_s, baked.scenario_text
    )


THREE_FMUS = Loop("three FMUs", "printer", ("height",), system_of)
ONE_BLOCK = Loop("LayerJob", JOB, ("height_mean", "volume_scale"), _block)
"""Both are bit by bit as `inkloop run` records them; droplets vary at random, and so the mean distinguishes prints."""


def scenario_in(folder: Path) -> Scenario:
    """The scenario, written to a folder."""
    (folder / "block.toml").write_text(TEXT, encoding="utf-8")
    return Scenario.load(folder / "block.toml")


def our_run(folder: Path) -> Any:
    """The dataset of our own master's print."""
    run = Print(scenario_in(folder)).run().dataset
    assert run.sizes["layer"] == LAYERS + 1
    return run


def difference(found: Any, expected: Any) -> str:
    """A message on the difference of two prints; "" where every bit is the same."""
    for layer, (one, other) in enumerate(zip(found, expected, strict=False), start=1):
        if not np.array_equal(one, other):
            return f"layer {layer} differs by up to {np.abs(one - other).max():.2g}"
    return "" if len(found) == len(expected) else f"{len(found)} layers instead of {len(expected)}"

"""Loops for masters of others: the loop of three FMUs, and the same print as one block with scalars."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.exchange.job import archive, baking
from inkloop.exchange.ssp.system import Part, System, system_of
from inkloop.fmu import describe
from inkloop.scenario.file import Scenario

JOB = "job"


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
    baked = baking.bake(scenario)
    file = folder / f"{JOB}.fmu"
    archive.write(baked, "2" if fmi == "2" else "3", file)
    step_s = scenario.tables.run.step_s
    return System(
        JOB, baked.title, [Part(JOB, file, describe(file), {})], [], {}, step_s, baked.stop_s, baked.scenario_text
    )


THREE_FMUS = Loop("three FMUs", "printer", ("height",), system_of)
ONE_BLOCK = Loop("LayerJob", JOB, ("height_mean", "volume_scale"), _block)
"""Both are bit by bit as `inkloop run` records them; droplets vary at random, and so the mean distinguishes prints."""

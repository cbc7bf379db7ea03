"""Components on a CAN bus: their kinds, and the model that replaces each in simulation.

The options of a device are those of the model in its place, so that a scenario goes from one to the other by its kinds
alone. A real device does not read them; they say how it is emulated. The package of the devices is loaded when one is
checked; a device is constructed with the bus of its loop, and opens nothing before it is initialized.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, cast

from numpy.typing import NDArray

from inkloop.component import Component, Job
from inkloop.components.fmu_parameters import parse_model
from inkloop.components.kind import Bench, Checked, load

__all__ = ["KINDS"]


@dataclass(frozen=True)
class Device:
    """A kind of device: the model in its place, and the class that drives it, whose `ports(job)` need no bus."""

    kind: str
    model: str
    module: str
    name: str
    path_option: ClassVar[str | None] = None

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check the options of its model. Raises FmuError where that is not there."""
        parsed = parse_model(self.model, job, options)
        if parsed.errors:
            return Checked(self.kind, parsed.errors)
        factory = load(self.module, self.name)
        own_job = _with_passes(job, parsed.values) if self.model == "LayerDeposition" else job

        def construct(bench: Bench, name: str) -> Component:
            cure = {"cure_ms": bench.table.cure_ms} if self.model == "LayerDeposition" else {}
            return cast(Component, factory(own_job, bench.rig, journal=bench.journal, **cure))

        return Checked(self.kind, (), factory.ports(own_job), construct)


KINDS: Mapping[str, Device] = {
    device.kind: device
    for device in (
        Device("hardware.printer", "LayerDeposition", "inkloop_hardware.devices.printer", "Printer"),
        Device("hardware.profiler", "ProfileSensor", "inkloop_hardware.devices.profiler", "Profiler"),
    )
}


def settle_layer(folder: Path, layer_is: str) -> None:
    """Write into the journal of a run what a person has seen of the open layer of a mapped rig.

    layer_is: "printed", "blank" or "unknown". Raises ComponentError if no layer is open.
    """
    load("inkloop_hardware.mapped.mapped_layer", "settle")(folder, layer_is)


def job_with_overrides(job: Job, options: Mapping[str, object]) -> Job:
    """The job with the passes that the options of its printer give, as the model in its place takes them."""
    return _with_passes(job, parse_model("LayerDeposition", job, options).values)


def _with_passes(job: Job, values: Mapping[str, NDArray[Any]]) -> Job:
    passes, order, rotation = (int(values[name]) for name in ("passes", "pass_order", "pass_rotation"))
    return replace(job, passes=passes, pass_order=order, pass_rotation=rotation)

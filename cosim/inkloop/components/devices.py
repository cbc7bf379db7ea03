"""Components on a CAN bus: which kinds there are, what each is called in simulation, and the one rig that they share.

The options of a device are those of the model in its place, so that a scenario goes from one to the other by its kinds
alone. A real device does not read them; they say how it is emulated. The package of the devices is loaded when one is
made, and opens nothing before it is initialized.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, cast

from inkloop.component import Component, Job
from inkloop.components import fmu_parameters
from inkloop.tables.schema import BenchTable

LOGGER = "inkloop_hardware"
"""Where devices say what they do."""


@dataclass(frozen=True)
class Device:
    """A kind of device: the model in its place, and the class that drives it."""

    model: str
    module: str
    name: str


KINDS: Mapping[str, Device] = {
    "hardware.printer": Device("LayerDeposition", "inkloop_hardware.devices.printer", "Printer"),
    "hardware.profiler": Device("ProfileSensor", "inkloop_hardware.devices.profiler", "Profiler"),
}


class Bench:
    """What the devices of one loop have in common. folder: of the master's journal, and of the traffic log."""

    def __init__(self, table: BenchTable | None = None, folder: Path | None = None) -> None:
        self.table = table or BenchTable()
        self._folder = folder

    @cached_property
    def rig(self) -> Any:
        """The bus with its nodes, not opened yet."""
        table = self.table
        settings = _load("inkloop_hardware.bus.settings", "BusSettings")(
            interface=table.interface,
            channel=table.channel,
            bitrate=table.bitrate,
            options=table.options,
            traffic_log=_free_name(self._folder, table.traffic_log) if self._folder and table.traffic_log else None,
            loop_timeout_s=table.loop_timeout_s,
        )
        return _load("inkloop_hardware.link.rig", "Rig")(settings, folder=self._folder)

    @cached_property
    def journal(self) -> Any:
        """What the master remembers of what it asked the nodes for; in the folder, if there is one."""
        return _load("inkloop_hardware.devices.master_journal", "MasterJournal")(self._folder)


def faults(kind: str, job: Job, options: Mapping[str, object]) -> list[str]:
    """Everything wrong with the options of a device. Raises FmuError where its model is not there."""
    return fmu_parameters.faults_of_model(KINDS[kind].model, job, options)


def make(kind: str, job: Job, options: Mapping[str, object], bench: Bench) -> Component:
    """A device with faultless options."""
    device = KINDS[kind]
    factory = _load(device.module, device.name)
    if device.model == "LayerDeposition":
        part = told(job, options)
        return cast(Component, factory(part, bench.rig, cure_ms=bench.table.cure_ms, journal=bench.journal))
    return cast(Component, factory(job, bench.rig, journal=bench.journal))


def told(job: Job, options: Mapping[str, object]) -> Job:
    """The job with the passes that the options of its printer say, as the model in its place would take them."""
    values = fmu_parameters.values_of_model("LayerDeposition", job, options)
    passes, order, rotation = (int(values[name]) for name in ("passes", "pass_order", "pass_rotation"))
    return replace(job, passes=passes, pass_order=order, pass_rotation=rotation)


def _free_name(folder: Path, name: str) -> Path:
    """The name, or with -2, -3, ... before its suffix: a resumed run keeps the traffic of its first part."""
    plain = Path(name)
    names = (plain if n == 1 else plain.with_stem(f"{plain.stem}-{n}") for n in range(1, 1_000_000))
    return next(one for one in names if not (folder / one).exists())


def _load(module: str, name: str) -> Any:
    return getattr(importlib.import_module(module), name)

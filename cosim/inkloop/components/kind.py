"""The interface of a component kind, and what the devices of one loop share.

Options are checked once, which yields ports and a factory.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from inkloop.component import Component, Job, Ports
from inkloop.errors import ScenarioError
from inkloop.tables.schema import BenchTable


class Bench:
    """Rig and journal of one loop, made when a device asks for them. folder: of journal and traffic log."""

    def __init__(self, table: BenchTable | None = None, folder: Path | None = None) -> None:
        self.table = table or BenchTable()
        self._folder = folder

    @cached_property
    def rig(self) -> Any:
        """The bus with its nodes, not opened yet."""
        table = self.table
        settings = load("inkloop_hardware.bus.settings", "BusSettings")(
            interface=table.interface,
            channel=table.channel,
            bitrate=table.bitrate,
            data_bitrate=table.data_bitrate,
            bit_rate_switch=table.bit_rate_switch,
            options=table.options,
            traffic_log=_free_name(self._folder, table.traffic_log) if self._folder and table.traffic_log else None,
            loop_timeout_s=table.loop_timeout_s,
            grace_s=table.grace_s,
            answer_s=table.answer_s,
            silence_s=table.silence_s,
        )
        return load("inkloop_hardware.link.rig", "Rig")(
            settings, folder=self._folder, valid_share=table.valid_share, on_part=table.on_part
        )

    @cached_property
    def journal(self) -> Any:
        """Journal of the master's requests to the nodes; in the folder, if there is one."""
        return load("inkloop_hardware.devices.master_journal", "MasterJournal")(self._folder)


def load(module: str, name: str) -> Any:
    """A name of a module that is imported when it is needed."""
    return getattr(importlib.import_module(module), name)


def _free_name(folder: Path, name: str) -> Path:
    """The name, or with -2, -3, ... before its suffix: a resumed run keeps the traffic of its first part."""
    plain = Path(name)
    names = (plain if n == 1 else plain.with_stem(f"{plain.stem}-{n}") for n in range(1, 1_000_000))
    return next(one for one in names if not (folder / one).exists())


@dataclass(frozen=True)
class Checked:
    """The checked options of one component. errors: one sentence each, beginning with the key; ports: None with errors.

    single: an FMU file of which a process takes one instance; buses: its bus terminals; notes: warnings.

    construct: makes a component from the options, of a loop's bench and by its name in it.
    """

    kind: str
    errors: Sequence[str] = ()
    ports: Ports | None = None
    construct: Callable[[Bench, str], Component] | None = None
    single: Path | None = None
    buses: Sequence[str] = ()
    is_bus_simulation: bool = False
    notes: Sequence[str] = ()

    def make(self, bench: Bench, name: str = "") -> Component:
        """A component, for the caller to terminate; bench: of all devices of its loop; name: its own in it.

        Raises ScenarioError with the errors, FmuError.
        """
        if self.errors or self.construct is None:
            raise ScenarioError(self.kind, self.errors)
        return self.construct(bench, name)


Check: TypeAlias = Callable[[str, Job, Mapping[str, object]], Checked]
"""`catalog.check`, handed to kinds that contain a component of another kind."""


class Kind(Protocol):
    """A kind of component. path_option: its option that names a file or folder relative to the scenario, if any."""

    @property
    def path_option(self) -> str | None: ...

    def check(self, job: Job, options: Mapping[str, object]) -> Checked:
        """Check options for a job; opens no bus and starts no FMU. Raises FmuError where an FMU cannot be read."""

"""The bus and the master's journal, shared by the devices of one loop."""

from __future__ import annotations

import importlib
from functools import cached_property
from pathlib import Path
from typing import Any

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

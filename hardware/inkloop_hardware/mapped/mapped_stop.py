"""A person's stop of a mapped rig, by the steps that its mapping has for it. No emergency stop."""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.mapped.mapped_bus import MappedBus
from inkloop_hardware.mapped.mapped_steps import MappedSteps
from inkloop_hardware.mapped.mapping_file import RigMapping


def stop_rig(settings: BusSettings, mapping: RigMapping) -> Iterator[str]:
    """Make the `[[stop]]` steps of a mapping beside a print that may be running, and yield what was done.

    HardwareError if there are none, or if one fails; BusError if the adapter cannot be used.
    """
    steps = mapping.tables.stop
    if not steps:
        raise HardwareError(
            f"{mapping.path}: has no [[stop]] steps, so nothing was sent: use the hard-wired stop of the rig. Steps "
            "that stop it, such as a frame, can be added to the mapping"
        )
    session = 1 + secrets.randbelow(0xFFFF)
    with closing(MappedBus(replace(settings, traffic_log=None), None, mapping, session, 1, is_alone=False)) as bus:
        MappedSteps(bus, mapping, 1).do("stop", steps, 0)
    yield f"all {len(steps)} [[stop]] steps of {mapping.path.name} were made; look at the rig before you go on"

"""Looks a bench over, one check after the other: adapter, bus, nodes, what they say, and on request gate and lamp.

Nothing is changed unless the self test is asked for. Nothing at all is sent while somebody else is master.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.adapter_check import before_opening, configured, hinders, opened
from inkloop_hardware.doctor.findings import Finding
from inkloop_hardware.doctor.inquiry import Expected, ask, links
from inkloop_hardware.doctor.listening import Heard, judge, judge_bus, listen
from inkloop_hardware.doctor.self_test import WHAT, try_gate_and_lamp
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.vocabulary import Node

NO_ADAPTER = "there is no adapter to look through"


def examine(
    settings: BusSettings, expected: Expected | None = None, *, self_test: bool = False, mapped: bool = False
) -> Iterator[Finding]:
    """All findings, in the order of the checks; what cannot be looked at any more is left out, in words.

    settings: of the bus, without a traffic log; expected: of the scenario, None without one; self_test: gate and lamp
    are tried; mapped: the rig speaks frames of its own, so only adapter and bus are looked at.
    """
    bus = configured(settings)
    before = list(before_opening(bus))
    yield from before
    if hinders(before):
        yield Finding.skipped("bus, nodes", NO_ADAPTER)
        return
    adapter, finding = opened(bus)
    yield finding
    if adapter is None:
        yield Finding.skipped("bus, nodes", NO_ADAPTER)
        return
    well = True
    try:
        with closing(adapter):
            codec = Codec()
            heard = listen(adapter, codec)
            if mapped:
                yield from judge_bus(heard, foreign=True)
                yield Finding.skipped("nodes", "this rig has frames of its own", "its mapping says what is waited for")
                return
            yield from judge(heard, codec)
            if heard.sessions:
                yield Finding.skipped("services", "somebody is master: a node that two ask at once answers neither")
                return
            if not heard.nodes:
                yield Finding.skipped("services", "there is nobody to ask")
                return
            for finding in ask(links(adapter, codec, _understood(heard, codec)), expected):
                well = well and not hinders([finding])
                yield finding
        yield from _tried(bus, self_test, well)
    except HardwareError as error:
        yield Finding.error("bus", str(error), "look at the adapter and its cables, then ask again")


def _understood(heard: Heard, codec: Codec) -> list[Node]:
    """Nodes of our protocol: what another one makes of our questions, nobody knows."""
    return [node for node in heard.nodes if heard.status[node].protocol_version == codec.protocol_version]


def _tried(settings: BusSettings, wanted: bool, well: bool) -> Iterator[Finding]:
    if not wanted:
        yield Finding.skipped("self test", f"gate and lamp were not tried ({WHAT})", "--self-test does it")
    elif not well:
        yield Finding.skipped("self test", "there are faults: nothing is energised", "mend them first")
    else:
        with Rig(settings) as rig:
            yield from try_gate_and_lamp(rig)

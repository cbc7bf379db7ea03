"""Examine a bench, one check after the other: adapter, bus, nodes, their answers, and on request gate and lamp.

Only the self test changes anything. Nothing is sent while another master is active.
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

NO_ADAPTER = "the adapter is not open"


def examine(
    settings: BusSettings, expected: Expected | None = None, *, self_test: bool = False, mapped: bool = False
) -> Iterator[Finding]:
    """All findings, in the order of the checks; a check that cannot be made is reported as skipped.

    settings: of the bus, without a traffic log; expected: of the scenario, None without one; self_test: gate and lamp
    are tried; mapped: the rig has a DBC of its own, so only adapter and bus are checked.
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
                yield Finding.skipped("nodes", "this rig has a DBC of its own", "see its mapping file")
                return
            yield from judge(heard, codec)
            if heard.sessions:
                yield Finding.skipped("services", "another master is active: a node with two masters answers neither")
                return
            if not heard.nodes:
                yield Finding.skipped("services", "no node is present")
                return
            for finding in ask(links(adapter, codec, _understood(heard, codec)), expected):
                well = well and not hinders([finding])
                yield finding
        yield from _tried(bus, self_test, well)
    except HardwareError as error:
        yield Finding.error("bus", str(error), "check the adapter and its cables, then try again")


def _understood(heard: Heard, codec: Codec) -> list[Node]:
    """Nodes with our version of the protocol: only these can be asked."""
    return [node for node in heard.nodes if heard.status[node].protocol_version == codec.protocol_version]


def _tried(settings: BusSettings, wanted: bool, well: bool) -> Iterator[Finding]:
    if not wanted:
        yield Finding.skipped("self test", f"gate and lamp were not tried ({WHAT})", "--self-test does it")
    elif not well:
        yield Finding.skipped("self test", "there are errors: nothing is energised", "correct them first")
    else:
        with Rig(settings) as rig:
            yield from try_gate_and_lamp(rig)

"""Examine a bench, one check after the other: adapter, bus, nodes, their answers, and on request gate and lamp.

Only the self test changes anything. Nothing is sent while another master is active.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.doctor.adapter_check import before_opening, configured, heartbeat_priority, opened
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.inquiry import Expected, ask, links
from inkloop_hardware.doctor.listening import Heard, judge, judge_bus, listen
from inkloop_hardware.doctor.self_test import WHAT, try_gate_and_lamp
from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.vocabulary import Node

NO_ADAPTER = "the adapter is not open"
LISTEN_AGAIN_S = 0.5
"""Seconds before the self test: five cycles of another master, which may have begun meanwhile."""


def examine(
    settings: BusSettings, expected: Expected | None = None, *, self_test: bool = False, mapped: bool = False
) -> Iterator[Finding]:
    """All findings, in the order of the checks; a check that cannot be made is reported as skipped.

    settings: of the bus, without a traffic log; expected: of the scenario, None without one; self_test: gate and lamp
    are tried; mapped: the rig has a DBC of its own, so only adapter and bus are checked.
    """
    bus = configured(settings)
    errors = list[Finding]()
    if not mapped:
        yield heartbeat_priority()
    yield from _noted(before_opening(bus), errors)
    if errors:
        yield Finding.skipped("bus, nodes", NO_ADAPTER)
        return
    adapter, finding = opened(bus)
    yield finding
    if adapter is None:
        yield Finding.skipped("bus, nodes", NO_ADAPTER)
        return
    try:
        with closing(adapter):
            codec = Codec()
            heard = listen(adapter, codec)
            if mapped:
                yield from judge_bus(heard, foreign=True)
                yield Finding.skipped("nodes", "this rig has a DBC of its own", "see its mapping file")
                return
            yield from _noted(judge(heard, codec), errors)
            if heard.sessions:
                yield Finding.skipped("services", "another master is active: a node with two masters answers neither")
                return
            if not heard.nodes:
                yield Finding.skipped("services", "no node is present")
                return
            asked = links(adapter, codec, _understood(heard, codec))
            yield from _noted(ask(asked, expected, heard.status), errors)
            refused = _why_not(self_test, errors, adapter, codec)
        if refused is not None:
            yield refused
            return
        with Rig(bus) as rig:
            yield from try_gate_and_lamp(rig)
    except HardwareError as error:
        yield Finding.error("bus", str(error), "check the adapter and its cables, then try again")


def _noted(findings: Iterable[Finding], errors: list[Finding]) -> Iterator[Finding]:
    """The findings; errors among them are added to `errors`."""
    for finding in findings:
        errors += [finding] if finding.grade is Grade.ERROR else []
        yield finding


def _understood(heard: Heard, codec: Codec) -> list[Node]:
    """Nodes with our version of the protocol: only these can be asked."""
    return [node for node in heard.nodes if heard.status[node].protocol_version == codec.protocol_version]


def _why_not(wanted: bool, errors: list[Finding], adapter: Adapter, codec: Codec) -> Finding | None:
    """The reason why gate and lamp are not tried; None if they may be. Listens once more: the checks have taken
    seconds.
    """
    if not wanted:
        return Finding.skipped("self test", f"gate and lamp were not tried ({WHAT})", "--self-test does it")
    if errors:
        return Finding.skipped("self test", "there are errors: nothing is energised", "correct them first")
    heard = listen(adapter, codec, LISTEN_AGAIN_S)
    if heard.sessions or heard.stopped:
        what = "another master is active" if heard.sessions else "a stop request is active"
        return Finding.error("self test", f"{what}: nothing is energised", "end it, then run the doctor again")
    return None

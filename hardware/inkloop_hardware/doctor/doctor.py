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
from inkloop_hardware.doctor.listening import Heard, judge, listen
from inkloop_hardware.doctor.mapped_rig import bus_of, judge_rig
from inkloop_hardware.doctor.self_test import WHAT, try_gate_and_lamp
from inkloop_hardware.doctor.status import check_second_reader
from inkloop_hardware.errors import AnotherMaster, HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapping_file import RigMapping
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.vocabulary import Node

NO_ADAPTER = "the adapter is not open"
LISTEN_AGAIN_S = 0.5
"""Seconds before the self test: five cycles of another master, which may have begun meanwhile."""


def examine(
    settings: BusSettings,
    expected: Expected | None = None,
    *,
    self_test: bool = False,
    mapping: RigMapping | None = None,
) -> Iterator[Finding]:
    """All findings, in the order of the checks; a check that cannot be made is reported as skipped.

    settings: of the bus, without a traffic log; expected: of the scenario, None without one; self_test: gate and lamp
    are tried; mapping: of a rig with frames of its own, of which those that it waits for are looked for.
    """
    bus = configured(settings) if mapping is None else bus_of(configured(settings), mapping)
    errors = list[Finding]()
    if mapping is None:
        yield heartbeat_priority()
    yield from _noted(before_opening(bus), errors)
    yield from _noted(_second_reader(settings), errors)
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
            if mapping is not None:
                yield from judge_rig(adapter, mapping)
                yield Finding.skipped("services", "nothing is sent to a rig with frames of its own: no peer was asked")
                return
            codec = Codec()
            heard = listen(adapter, codec)
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


def _second_reader(settings: BusSettings) -> Iterator[Finding]:
    """An error if a print has an adapter that has one reader."""
    try:
        check_second_reader(settings)
    except AnotherMaster as error:
        yield Finding.error("adapter", str(error), "wait until the print ends, then run the doctor again")


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

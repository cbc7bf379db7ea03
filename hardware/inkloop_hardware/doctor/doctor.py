"""Examine a bench, one check after the other: adapter, bus, nodes, their answers, and on request gate and lamp.

Only the self test changes anything: the gate opens and closes, the lamp lights for a moment behind the closed gate.
Nothing is jetted, no layer records it, and it runs on request only: light leaves the lamp. Nothing is sent while
another master is active.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import closing
from struct import pack

from inkloop.units import MS_PER_S
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.fmu_bus import INTERFACE as FMU
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.devices.readiness import MARGIN_S, blocked, clear
from inkloop_hardware.doctor.adapter_check import before_opening, configured, heartbeat_priority, opened
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.inquiry import Expected, ask, links
from inkloop_hardware.doctor.listening import Heard, judge, listen
from inkloop_hardware.doctor.status import bus_of, check_second_reader, judge_rig
from inkloop_hardware.errors import AnotherMaster, HardwareError, NodeRefused
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapping_file import RigMapping
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Routine

LAMP_MS = 100
NODES = (Node.HEAD, Node.CURE)
OUT_OF_RANGE = 0x31
WHAT = f"the gate opens and closes, then the lamp lights for {LAMP_MS} ms with the gate closed"


def try_gate_and_lamp(rig: Rig) -> Iterator[Finding]:
    """Run both tests, one after the other, on an attached rig; nothing is enabled after them.

    Raises HardwareError if the bus or a node is lost.
    """
    rig.wait_for(NODES)
    for node in NODES:
        state = rig.link(node).state()
        if (reason := blocked(node, state)) is not None:
            found, _, advice = reason.partition("; ")
            yield Finding.skipped("self test", found, advice)
            return
        clear(rig, node)
    for test in (_gate, _lamp):
        finding = test(rig)
        yield finding
        if finding.grade is not Grade.OK:  # no light behind a gate that cannot be trusted
            return


def _gate(rig: Rig) -> Finding:
    head = rig.link(Node.HEAD)
    try:
        with rig.enabled(gate=True):
            _test(rig, head, 0)
        times = head.times()
    except HardwareError as error:
        return _failed(head, error)
    open_ms = (times.gate_closed - times.gate_opened) * MS_PER_S
    return Finding.ok("self test", f"gate: seen open and closed again, driven for {open_ms:.0f} ms")


def _lamp(rig: Rig) -> Finding:
    lamp = rig.link(Node.CURE)
    try:
        with rig.enabled(lamp=True):
            _test(rig, lamp, LAMP_MS)
        times = lamp.times()
    except HardwareError as error:
        return _failed(lamp, error)
    lit_ms = (times.lamp_off - times.lamp_on) * MS_PER_S
    return Finding.ok("self test", f"lamp: seen lit for {lit_ms:.0f} ms and dark again, the gate closed")


def _test(rig: Rig, link: Link, lamp_ms: int) -> None:
    limits = link.limits()
    limit_s = lamp_ms / MS_PER_S + 2 * limits.gate + MARGIN_S
    link.routine(Routine.SELF_TEST, Key(rig.job, 0, 0), pack(">H", lamp_ms), limit_s=limit_s)


def _failed(link: Link, error: HardwareError) -> Finding:
    if isinstance(error, NodeRefused) and error.code == OUT_OF_RANGE:
        reason = f"the firmware of the {link.node.lower()} has no self test"
        return Finding.skipped("self test", reason, "update it, or watch gate and lamp in the first layer")
    return Finding.error("self test", str(error), "everything is off; check gate, end switches and lamp before a print")


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
    if mapping is None and bus.interface != FMU:
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

"""Self test of gate and lamp: the gate opens and closes, the lamp lights for a moment behind the closed gate.

Nothing is jetted and no layer records it. It runs on request only: light leaves the lamp.
"""

from __future__ import annotations

from collections.abc import Iterator
from struct import pack

from inkloop.units import MS_PER_S
from inkloop_hardware.devices.readiness import MARGIN_S, blocked, clear
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.errors import HardwareError, NodeRefused
from inkloop_hardware.link.link import Link
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.services import Key, Routine
from inkloop_hardware.protocol.vocabulary import Node

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

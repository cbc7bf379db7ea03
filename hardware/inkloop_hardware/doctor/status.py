"""State of a bench for a person: of every node, asked for or only heard while a print runs; of a mapped rig, the frames
that its mapping waits for. Nothing is changed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, replace

from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.bus.settings import BusSettings, holder
from inkloop_hardware.devices.readiness import missing
from inkloop_hardware.doctor.adapter_check import configured
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.doctor.listening import LISTEN_S, LISTEN_SILENCES, Heard, judge_bus, listen
from inkloop_hardware.errors import AnotherMaster
from inkloop_hardware.link.node_watch import sentence
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.mapped.mapped_bus import Readings
from inkloop_hardware.mapped.mapping_file import RigMapping
from inkloop_hardware.protocol.codec import Codec, id_of, id_text
from inkloop_hardware.protocol.node_state import Flags, NodeState
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, State

CONDITIONS = {
    Flags.NEEDS_OPERATOR: "needs a person to clear it",
    Flags.STOPPED: "a stop request is active",
    Flags.DRY_RUN: "in a dry run",
    Flags.JOURNAL_DAMAGED: "its journal is damaged",
    Flags.JOURNAL_UNREADABLE: "its journal could not be read at power-up",
    Flags.BY_WATCHDOG: "reset by its watchdog",
}
"""Flag of a node -> its meaning for a person."""


@dataclass(frozen=True)
class NodeReport:
    """State and memory of a node; as text one line for a person.

    cause: the reason why it is off, if it is; job, layer: of its open layer, with `passes` in all, `done` and
    `unknown`, 0 without one; conditions: notes for a person.
    """

    node: str
    state: str
    cause: str | None
    job: int
    layer: int
    passes: int
    done: int
    unknown: int
    conditions: tuple[str, ...]
    version: str

    def __str__(self) -> str:
        """`head     SAFE because of STOP_REQUEST, needs a person to clear it; inkloop 0.1.0`."""
        found = [self.state + (f" because of {self.cause}" if self.cause else "")]
        if self.passes:
            found.append(f"layer {self.layer} of job {self.job}: {self.done} of {self.passes} passes done")
        if self.unknown:
            found.append(f"{self.unknown} unknown")
        return f"{self.node:8s} {', '.join((*found, *self.conditions))}; {self.version}"


def status(rig: Rig) -> Iterator[NodeReport | str]:
    """A report of each node: state, newest layer, required actions; rig: closed.

    While a print runs, on this machine or another, nothing is sent: a line for each node with what was heard of it.
    """
    try:
        rig.attach()
    except AnotherMaster as other:
        yield from _overheard(rig, other)
        return
    try:
        rig.wait_for(Node)
        for node in Node:
            link = rig.link(node)
            yield _report(node, link.state(), link.version(), rig.status(node))
    finally:
        rig.detach()


def _overheard(rig: Rig, other: AnotherMaster) -> Iterator[str]:
    """Status frames of the nodes, nothing sent. Raises `other` where a second reader gets none beside its print."""
    settings = configured(rig.settings)
    check_second_reader(rig.settings, other)
    with closing(Adapter(settings)) as adapter:
        heard = listen(adapter, Codec())
    masters = ", ".join(f"session {session} prints job {job}" for session, job in heard.sessions.items())
    yield f"{masters or 'a print has the channel'}: nothing was sent, this was heard in {heard.lasted:.1f} s"
    if heard.stopped:
        yield "a stop request is active"
    for node in Node:
        yield _heard_of(node, heard)


def check_second_reader(settings: BusSettings, other: AnotherMaster | None = None) -> None:
    """Raise AnotherMaster if a print of this machine has a channel that a second program must not open."""
    owner = holder(settings)
    if owner and configured(settings).has_one_reader:
        raise AnotherMaster(
            f"{settings}: a print has the adapter ({owner}), and its serial port has one reader: nothing was opened. "
            "The log of the run, `bench.log` in its folder, says what the nodes do"
        ) from other


def _heard_of(node: Node, heard: Heard) -> str:
    last, count = heard.status.get(node), len(heard.times[node])
    if last is None:
        damaged = heard.monitors[node].damaged
        return f"{node.lower()}: {f'{damaged} damaged statuses' if damaged else 'no status'}"
    return f"{sentence(node, last)}, {count} statuses"


def _report(node: Node, state: NodeState, version: str, status: NodeStatus | None) -> NodeReport:
    off = state.state in (State.SAFE, State.FAULT) and state.cause != Fault.NONE
    return NodeReport(
        node.lower(),
        state.state.name,
        state.cause.name if off else None,
        *((state.job, state.layer) if state.passes else (0, 0)),
        state.passes,
        state.done.bit_count(),
        state.unknown.bit_count(),
        (
            *(words for flag, words in CONDITIONS.items() if state.flags & flag),
            *(reason.partition("; ")[0] for reason in missing(node, status)),
        ),
        version,
    )


CYCLES = 3.0
"""Cycles of a frame in which it must come (assumed)."""


def bus_of(settings: BusSettings, mapping: RigMapping) -> BusSettings:
    """The settings of a bus for the frames of a mapping."""
    return replace(settings, fd=settings.fd or mapping.needs_fd)


def judge_rig(adapter: Adapter, mapping: RigMapping) -> Iterator[Finding]:
    """Bus, and every frame that the mapping waits for: an error for one that does not come or cannot be read."""
    readings = Readings(mapping.codec)
    heard = listen(adapter, mapping.codec, _seconds(adapter.settings, mapping), readings.take)
    yield from judge_bus(heard, foreign=True)
    for message, signals in mapping.tables.awaited.items():
        yield _judged(message, signals, readings, mapping, heard)


def rig_status(settings: BusSettings, mapping: RigMapping) -> Iterator[str]:
    """A line for each frame that the mapping waits for, beside a print or without one. AnotherMaster, BusError."""
    check_second_reader(settings)
    with closing(Adapter(bus_of(configured(settings), mapping))) as adapter:
        for finding in judge_rig(adapter, mapping):
            yield finding.found if finding.grade is Grade.OK else f"{finding.found}; {finding.advice}"


def _seconds(settings: BusSettings, mapping: RigMapping) -> float:
    cycles = [mapping.codec.cycle_time(message) or 0.0 for message in mapping.tables.awaited]
    return max(LISTEN_S, LISTEN_SILENCES * settings.silence_s, CYCLES * max(cycles, default=0.0))


def _judged(message: str, signals: dict[str, str], readings: Readings, mapping: RigMapping, heard: Heard) -> Finding:
    name = f"{message} ({id_text(id_of(mapping.codec.message(message)))})"
    waiting = " and ".join(signals.values())
    if not readings.counts[message]:
        advice = f"{waiting} waits for it: is the rig powered, on this bus, at this bit rate, and is this its id?"
        return Finding.error("frames", f"{name}: none came in {heard.lasted:.1f} s", advice)
    count = f"{readings.counts[message]} in {heard.lasted:.1f} s"
    if message not in readings.newest:
        advice = f"{waiting} waits for it: compare the DBC with the rig"
        return Finding.error("frames", f"{name}: {count}, but {readings.found(message, '')}", advice)
    values = ", ".join(f"{signal}: {readings.found(message, signal)}" for signal in signals)
    if any(signal in readings.newest[message].dropped for signal in signals):
        return Finding.warning("frames", f"{name}: {count}; {values}", "compare limits and value tables with the rig")
    return Finding.ok("frames", f"{name}: {count}; {values}")

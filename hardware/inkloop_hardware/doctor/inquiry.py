"""Checks by requests to the nodes of a bench, without a master on the bus: nothing is changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from inkloop.component import Job
from inkloop.units import MS_PER_S
from inkloop_hardware.bus.adapter import Adapter
from inkloop_hardware.devices.readiness import ROLES, blocked, missing
from inkloop_hardware.doctor.findings import Finding, Grade
from inkloop_hardware.errors import BusError, HardwareError
from inkloop_hardware.link.link import Link
from inkloop_hardware.protocol.codec import Codec, Frame
from inkloop_hardware.protocol.node_state import Flags, JournalRecord, NodeLimits, NodeState
from inkloop_hardware.protocol.records import Fault, MasterAlive, Node, NodeStatus, State
from inkloop_hardware.protocol.transfer_bytes import PatternBytes

CLOCK_TOLERANCE = 0.02
"""Share by which a node's clock may be off (assumed): its 300 ms without a master are then 294 to 306 ms."""
CLOCK_SPAN = 0.25
"""Seconds between two readings of a clock, at least."""
CLOCK_STEP = 1e-3
BLOCK_LEAST = 16
"""Bytes of a transfer block below which a pattern takes minutes (assumed)."""


class OwnWire:
    """The wire of a link on an adapter of this process, without a heartbeat."""

    def __init__(self, adapter: Adapter, answer_id: int) -> None:
        self._adapter, self._answer_id = adapter, answer_id
        self._waiting: list[bytes] = []

    def begin(self) -> None:
        """Nothing to watch."""

    def check(self) -> None:
        """Nothing to watch."""

    def now(self) -> float:
        """Seconds of a clock that only goes forward."""
        return self._adapter.now()

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""
        for frame in frames:
            self._adapter.send(frame)

    def receive(self, wait_s: float) -> bytes | None:
        """Data of the next ISO-TP frame of the node, None if none comes within `wait_s`."""
        until = self.now() + wait_s
        while not self._waiting:
            found = self._adapter.receive(max(0.0, min(wait_s, until - self.now())))
            self._waiting += [bytes(one.data) for one in found if one.arbitration_id == self._answer_id]
            if self.now() >= until:
                break
        return self._waiting.pop(0) if self._waiting else None


@dataclass(frozen=True)
class Expected:
    """Requirements of a scenario on the nodes: its job, and the light after each pass [ms]."""

    job: Job
    cure_ms: int


@dataclass(frozen=True)
class ClockReading:
    """A reading of a node's clock [s], requested and answered at two seconds of ours."""

    node: float
    asked: float
    answered: float


@dataclass(frozen=True)
class NodeReport:
    """The answers of one node; map_shape: of a profiler, else None; status: the last one that was heard."""

    node: Node
    version: str
    state: NodeState
    limits: NodeLimits
    journal: tuple[JournalRecord, ...]
    map_shape: tuple[int, int] | None
    clock: tuple[ClockReading, ClockReading]
    status: NodeStatus | None = None


def links(adapter: Adapter, codec: Codec, nodes: Sequence[Node]) -> list[Link]:
    """Links to these nodes."""
    return [Link(node, codec, OwnWire(adapter, codec.answer_id(node)), str(adapter.settings)) for node in nodes]


def read_node(link: Link, status: NodeStatus | None = None) -> NodeReport:
    """Read everything that the checks need of a node whose last status is known. Raises HardwareError."""
    first = _read_clock(link)
    shape = None
    if link.node is Node.PROFILER:
        size = link.map_size()
        shape = (size.nx, size.ny)
    version, state, limits, journal = link.version(), link.state(), link.limits(), link.journal()
    link.pause(first.answered + CLOCK_SPAN - link.now())
    return NodeReport(link.node, version, state, limits, journal, shape, (first, _read_clock(link)), status)


def ask(
    asked: Sequence[Link], expected: Expected | None, heard: Mapping[Node, NodeStatus] | None = None
) -> Iterator[Finding]:
    """Check services, states, clocks, journals and limits; heard: the last statuses of the nodes.

    BusError when the adapter is disconnected.
    """
    reports = []
    for link in asked:
        try:
            reports.append(read_node(link, (heard or {}).get(link.node)))
        except BusError:
            raise
        except HardwareError as error:
            yield Finding.error(
                "services", str(error), "does the node run this inkloop's firmware, or an ISO-TP of its own?"
            )
    yield from assess(reports, expected)


def assess(reports: Sequence[NodeReport], expected: Expected | None) -> Iterator[Finding]:
    """Findings about nodes that have answered."""
    if not reports:
        return
    yield from merge([Finding.ok("services", f"{report.node.lower()}: {report.version}") for report in reports])
    for check in (_states, _clocks, _journals):
        yield from merge([finding for report in reports for finding in check(report)])
    if expected is None:
        yield Finding.skipped("limits", "no scenario was given to compare them with")
    else:
        yield from merge([finding for report in reports for finding in _limits(report, expected)])


def merge(findings: Sequence[Finding]) -> Iterator[Finding]:
    """Merge equal passing findings of several nodes."""
    names: dict[str, list[str]] = {}
    for finding in findings:
        if finding.grade is Grade.OK:
            name, _, found = finding.found.partition(": ")
            names.setdefault(found, []).append(name)
        else:
            yield finding
    for found, nodes in names.items():
        yield Finding.ok(findings[0].check, f"{', '.join(nodes)}: {found}")


def _read_clock(link: Link) -> ClockReading:
    asked = link.now()
    return ClockReading(link.times().now, asked, link.now())


def _states(report: NodeReport) -> Iterator[Finding]:
    for condition in missing(report.node, report.status):
        what, _, remedy = condition.partition("; ")
        yield Finding.error("states", f"{report.node.lower()}: {what}", remedy)
    state, name = report.state, report.node.lower()
    because = f" because of {state.cause.name}" if state.cause is not Fault.NONE else ""
    if not state.roles & ROLES[report.node]:
        yield Finding.error(
            "states", f"{name}: the node at its ids has the roles {state.roles!s}", "give it its own ids"
        )
    if (reason := blocked(report.node, state)) is not None:
        found, _, advice = reason.partition("; ")
        yield Finding.error("states", found, advice)
    elif state.state is State.FAULT:
        yield Finding.error(
            "states", f"{name}: FAULT{because}", "check the device, then `inkloop bench clear SCENARIO`"
        )
    elif state.flags & Flags.DRY_RUN:
        yield Finding.warning("states", f"{name}: in a dry run", "the next run ends it")
    else:
        yield Finding.ok("states", f"{name}: {state.state.name}{because}")


def _clocks(report: NodeReport) -> Iterator[Finding]:
    name = report.node.lower()
    slowest, fastest = clock_rates(*report.clock)
    if report.clock[1].node < report.clock[0].node:
        yield Finding.error("clock", f"{name}: its clock went back during the check: it restarted", "check its supply")
    elif fastest < 1 - CLOCK_TOLERANCE or slowest > 1 + CLOCK_TOLERANCE:
        rate = (slowest + fastest) / 2
        yield Finding.error(
            "clock",
            f"{name}: its clock runs {abs(rate - 1):.0%} too {'fast' if rate > 1 else 'slow'}",
            "its time limits are off by as much: correct the clock of its board",
        )
    else:
        yield Finding.ok("clock", f"{name}: runs as fast as ours")


def clock_rates(first: ClockReading, last: ClockReading) -> tuple[float, float]:
    """Seconds of the node's clock per second of ours: the least and the most that two readings allow."""
    passed = last.node - first.node
    most = max(last.asked - first.answered, CLOCK_STEP)
    return (passed - CLOCK_STEP) / (last.answered - first.asked), (passed + CLOCK_STEP) / most


def _journals(report: NodeReport) -> Iterator[Finding]:
    name, records = report.node.lower(), report.journal
    if report.state.flags & (Flags.JOURNAL_DAMAGED | Flags.JOURNAL_UNREADABLE):
        return  # reported with its state
    if not records:
        yield Finding.warning(
            "journals", f"{name}: its journal is empty", "a node records at least its power-up: is its storage new?"
        )
        return
    if any(newer.number != older.number + 1 for newer, older in pairwise(records)):
        yield Finding.warning(
            "journals",
            f"{name}: a record between {records[-1].number} and {records[0].number} cannot be read",
            "a record that a power failure interrupted is not valid; if it happens again, replace the storage",
        )
    else:
        yield Finding.ok("journals", f"{name}: its newest {len(records)} of {records[0].number} records can be read")


def _limits(report: NodeReport, expected: Expected) -> Iterator[Finding]:
    name, limits, job = report.node.lower(), report.limits, expected.job
    errors = []
    if report.node is Node.HEAD:
        needed = PatternBytes.cells_of(job.nx, job.ny, materials=len(job.inks))
        if needed > limits.pattern_bytes:
            found = (
                f"a pattern of {job.nx} x {job.ny} cells takes {needed} bytes, it has room for {limits.pattern_bytes}"
            )
            errors.append((found, "set a smaller grid, or use a head with more memory"))
    if report.map_shape not in (None, (0, 0), (job.nx, job.ny)):
        shape = " x ".join(map(str, report.map_shape or ()))
        found = f"its maps have {shape} cells, the scenario {job.nx} x {job.ny}"
        advice = "set the profiler to the scenario's grid, or grid.nx and grid.ny to what it measures"
        errors.append((found, advice))
    if report.node is Node.CURE and expected.cure_ms / MS_PER_S >= limits.lamp:
        lamp_ms = limits.lamp * MS_PER_S
        found = f"bench.cure_ms is {expected.cure_ms}, this lamp switches itself off after {lamp_ms:.0f} ms"
        errors.append((found, "set a smaller bench.cure_ms"))
    if limits.block < BLOCK_LEAST:
        errors.append((f"it takes blocks of {limits.block} bytes", "give its ISO-TP more room"))
    cycle = Codec().cycle_time(MasterAlive.message) or 0.1
    if limits.alive < 2 * cycle:
        waited_ms, cycle_ms = limits.alive * MS_PER_S, cycle * MS_PER_S
        found = f"it waits {waited_ms:.0f} ms for MasterAlive, which comes every {cycle_ms:.0f} ms"
        errors.append((found, "300 ms let two frames be lost"))
    for found, advice in errors:
        yield Finding.error("limits", f"{name}: {found}", advice)
    if not errors:
        yield Finding.ok("limits", f"{name}: can print the scenario")

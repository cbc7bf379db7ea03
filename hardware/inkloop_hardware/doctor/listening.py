"""Checks by listening alone: the nodes on the bus, their cycles and supervision, and other masters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from statistics import median

from inkloop.units import MS_PER_S
from inkloop_hardware.bus.adapter import Adapter, data_frame
from inkloop_hardware.doctor.findings import Finding
from inkloop_hardware.errors import FrameError
from inkloop_hardware.link.node_watch import LOST_AFTER, E2eMonitor
from inkloop_hardware.protocol.codec import EXTENDED, Codec, Frame
from inkloop_hardware.protocol.records import KINDS, MasterAlive, Node, NodeStatus, StopRequest, unpack

LISTEN_S = 1.2
"""Twelve statuses of a healthy node, and at least one MasterAlive of any master; at least `LISTEN_SILENCES`."""
LISTEN_SILENCES = 2.0
"""Silences after which a run takes a node for lost: a silence of this length is noticed."""
CYCLE_SLACK = 0.25
"""Share of its cycle by which the median of a status may be off (assumed)."""
LOST_SHARE = 0.1
"""Lost frames per received frame from which on transfers fail (assumed)."""
CHECK_NODE = "is it powered, on this bus, at this bit rate, and with the ids of its role?"


@dataclass
class Heard:
    """Everything that was received in `lasted` seconds; `times`: seconds of the intact statuses of each node;
    `silence_s`: seconds without a status after which a run takes a node for lost.
    """

    lasted: float = 0.0
    silence_s: float = LOST_AFTER
    frames: int = 0
    errors: int = 0
    others: Counter[int] = field(default_factory=Counter)
    """frames with ids outside the protocol"""
    times: dict[Node, list[float]] = field(default_factory=lambda: {node: [] for node in Node})
    status: dict[Node, NodeStatus] = field(default_factory=dict)
    monitors: dict[Node, E2eMonitor] = field(default_factory=lambda: {node: E2eMonitor() for node in Node})
    sessions: dict[int, int] = field(default_factory=dict)
    """job by session of every master"""
    stopped: bool = False
    misread: set[str] = field(default_factory=set)
    complaints: Mapping[str, int] = field(default_factory=dict)

    def take(self, now: float, frame: Frame, codec: Codec) -> None:
        """Take one frame that was received at second `now`."""
        self.frames += 1
        try:
            reading = codec.decode(frame)
            node = KINDS.get(reading.message, (None, None))[1]
            is_status = node is not None and reading.message.endswith(NodeStatus.message)
            if is_status and node is not None:
                self.monitors[node].take(reading.intact, reading.counter or 0)
            if not reading.intact or reading.message not in KINDS:
                return
            record = unpack(codec, reading)
        except FrameError as error:
            if any(message.frame_id == frame.arbitration_id for message in codec.database.messages):
                self.misread.add(str(error))
            else:
                self.others[frame.arbitration_id] += 1
            return
        if isinstance(record, NodeStatus):
            self.times[record.node].append(now)
            self.status[record.node] = record
        elif isinstance(record, MasterAlive):
            self.sessions[record.session] = record.job
        elif isinstance(record, StopRequest):
            self.stopped = record.active

    @property
    def nodes(self) -> list[Node]:
        """Nodes with intact statuses."""
        return [node for node in Node if self.times[node]]

    @property
    def speaking(self) -> list[Node]:
        """Nodes with a status of any kind, damaged ones included."""
        return [node for node in Node if self.times[node] or self.monitors[node].damaged]


def listen(
    adapter: Adapter,
    codec: Codec,
    seconds: float | None = None,
    take: Callable[[Frame], object] | None = None,
) -> Heard:
    """Read the bus and send nothing. BusError when the adapter is disconnected.

    seconds: None is long enough for `judge`; take: takes each frame in place of the protocol, and none is of it.
    """
    silence_s = adapter.settings.silence_s
    seconds = max(LISTEN_S, LISTEN_SILENCES * silence_s) if seconds is None else seconds
    heard, begin = Heard(silence_s=silence_s), adapter.now()
    while (now := adapter.now()) < begin + seconds:
        for message in adapter.receive(min(0.05, begin + seconds - now)):
            if message.is_error_frame:
                heard.errors += 1
            elif (frame := data_frame(message)) is not None and take is not None:
                heard.frames += 1
                take(frame)
            elif frame is not None and not (frame.is_fd or frame.arbitration_id & EXTENDED):
                heard.take(adapter.now(), frame, codec)
    heard.lasted = adapter.now() - begin
    heard.complaints = {what: count for what, count in adapter.complaints().items() if count}
    return heard


def judge(heard: Heard, codec: Codec) -> Iterator[Finding]:
    """Bus, masters, nodes, heartbeats, supervision and protocol."""
    yield from judge_bus(heard)
    yield from _masters(heard)
    if not heard.speaking:
        advice = "is the bench powered, and the cable plugged in?" if heard.frames == 0 else CHECK_NODE
        yield Finding.error("nodes", f"no node sent anything in {heard.lasted:.1f} s", advice)
        return
    missing = [node.lower() for node in Node if node not in heard.speaking]
    if missing:
        yield Finding.error("nodes", f"{' and '.join(missing)} sent nothing in {heard.lasted:.1f} s", CHECK_NODE)
    else:
        yield Finding.ok("nodes", f"{', '.join(node.lower() for node in Node)} are present")
    yield from _heartbeats(heard, codec)
    yield from _supervision(heard)
    yield from _protocol(heard, codec)


def judge_bus(heard: Heard, *, foreign: bool = False) -> Iterator[Finding]:
    """Frames and errors. foreign: the rig has a DBC of its own, none of its frames must be of the protocol."""
    wires = "check cables, 120 ohm at both ends, and the bit rate of every node (the bench has 500 kbit/s)"
    if heard.frames == 0:
        yield Finding.error("bus", f"no frame was received within {heard.lasted:.1f} s", wires)
    elif not heard.speaking and heard.others and not foreign:
        ids = ", ".join(f"0x{number:03X}" for number, _ in heard.others.most_common(4))
        yield Finding.error(
            "bus", f"{heard.frames} frames were received, none of the protocol ({ids})", "is this the right bus?"
        )
    else:
        yield Finding.ok("bus", f"{heard.frames} frames in {heard.lasted:.1f} s")
        if heard.others and not foreign:
            ids = ", ".join(f"0x{number:03X}" for number, _ in heard.others.most_common(4))
            yield Finding.warning(
                "bus", f"{heard.others.total()} frames outside the protocol ({ids})", "they load the bus"
            )
    if heard.errors:
        yield Finding.error("bus", f"{heard.errors} error frames", wires)
    for what, count in heard.complaints.items():
        if "error frames" not in what:
            yield Finding.error("bus", f"{count} {what}", "check the adapter, its USB cable and its bit rate")


def _masters(heard: Heard) -> Iterator[Finding]:
    if not heard.sessions:
        yield Finding.ok("masters", "no other master is active")
    elif len(heard.sessions) == 1:
        session, job = next(iter(heard.sessions.items()))
        yield Finding.error(
            "masters",
            f"another master is active: session {session}, job {job}",
            "a run is in progress; end it or wait for its end. Two masters at once stop every node",
        )
    else:
        sessions = ", ".join(str(session) for session in heard.sessions)
        yield Finding.error(
            "masters", f"there are {len(heard.sessions)} masters, sessions {sessions}", "end all but one"
        )
    if heard.stopped:
        yield Finding.error(
            "masters",
            "a stop request is active",
            "look at the bench, then `inkloop bench release SCENARIO` (or where it was made) and `clear`",
        )


def _heartbeats(heard: Heard, codec: Codec) -> Iterator[Finding]:
    regular = []
    for node in heard.nodes:
        cycle = codec.cycle_time(f"{node}{NodeStatus.message}") or 0.1
        gaps = [later - earlier for earlier, later in pairwise(heard.times[node])]
        if not gaps:
            yield Finding.error("heartbeat", f"{node.lower()}: a single status in {heard.lasted:.1f} s", CHECK_NODE)
        elif max(gaps) > heard.silence_s:
            yield Finding.error(
                "heartbeat",
                f"{node.lower()}: {max(gaps) * MS_PER_S:.0f} ms between two statuses, the cycle is "
                f"{cycle * MS_PER_S:.0f} ms",
                f"a run takes the node for lost after {heard.silence_s * MS_PER_S:.0f} ms: check cables and its load",
            )
        elif abs(median(gaps) - cycle) > CYCLE_SLACK * cycle:
            yield Finding.warning(
                "heartbeat",
                f"{node.lower()}: a status every {median(gaps) * MS_PER_S:.0f} ms, the cycle is "
                f"{cycle * MS_PER_S:.0f} ms",
                "does its firmware have another protocol, or is this machine busy?",
            )
        else:
            regular.append(median(gaps))
    if regular:
        number = f"{len(regular)} nodes" if len(regular) > 1 else "one node"
        cycles = f"{min(regular) * MS_PER_S:.0f} to {max(regular) * MS_PER_S:.0f} ms"
        yield Finding.ok("heartbeat", f"{number}, a status every {cycles}")


def _supervision(heard: Heard) -> Iterator[Finding]:
    passed = True
    for node, monitor in heard.monitors.items():
        bad = {"damaged": monitor.damaged, "repeated": monitor.repeated, "jumped": monitor.jumped}
        if any(bad.values()):
            passed = False
            counts = ", ".join(f"{count} {kind}" for kind, count in bad.items() if count)
            verdict = "" if monitor.trusted else "; it cannot be trusted"
            yield Finding.error(
                "supervision",
                f"{node.lower()}: of its statuses {counts}{verdict}",
                "damaged: cables, adapter, or another data id; repeated or jumped: do two nodes use its ids?",
            )
        elif monitor.lost:
            passed = passed and monitor.lost <= LOST_SHARE * len(heard.times[node])
            grade = Finding.warning if monitor.lost <= LOST_SHARE * len(heard.times[node]) else Finding.error
            yield grade(
                "supervision",
                f"{node.lower()}: {monitor.lost} statuses were lost, {len(heard.times[node])} received",
                "check cables, termination, and the load of bus and adapter",
            )
    if passed:
        counted = sum(len(times) for times in heard.times.values())
        yield Finding.ok("supervision", f"check bytes and counters of {counted} statuses are right")


def _protocol(heard: Heard, codec: Codec) -> Iterator[Finding]:
    ours = codec.protocol_version
    other = {node: status.protocol_version for node, status in heard.status.items() if status.protocol_version != ours}
    for node, version in other.items():
        yield Finding.error(
            "protocol",
            f"{node.lower()} has version {version} of the protocol, this inkloop {ours}",
            "update the older of the two",
        )
    for message in sorted(heard.misread):
        yield Finding.error("protocol", message, "update the older of the two, or use this inkloop's DBC in the node")
    if not other and not heard.misread and heard.status:
        yield Finding.ok("protocol", f"version {ours} of the protocol, as in the DBC of this inkloop")

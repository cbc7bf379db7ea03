"""Watch of one node by its frames: status, faults, whether it is alive and can be trusted; watch of other masters and
stop requests.

`E2eMonitor` follows the check bytes and counters of one supervised message: with two bad frames among the last five the
sender counts as missing, until fewer than two of the last five are bad. It does not detect silence: that needs a clock.
`firmware/can/e2e_monitor.c` follows the same rules.
"""

from __future__ import annotations

import logging
from collections import deque
from dataclasses import dataclass, field
from enum import IntEnum

from inkloop_hardware.protocol.codec import COUNTERS
from inkloop_hardware.protocol.records import (
    Fault,
    MasterAlive,
    Node,
    NodeFault,
    NodeStatus,
    Source,
    State,
    StopRequest,
)

WINDOW = 5
"""Frames that count for the verdict."""
BAD_LIMIT = 2
"""Bad frames among them from which on the sender counts as missing."""
LOST_MAX = 2
"""Frames that may be lost in a row: at the third cycle the sender is missing anyway."""
STUCK_AFTER = 3
"""Repeats in a row that make a stuck counter."""


class Verdict(IntEnum):
    """Verdict on one frame; from REPEATED on the frame is bad."""

    FIRST = 0
    """no earlier frame to compare with"""
    GOOD = 1
    """the next counter"""
    LOST = 2
    """up to LOST_MAX frames are missing before it"""
    REPEATED = 3
    """the counter of the last frame"""
    JUMPED = 4
    """any other counter; the next frame is compared with it"""
    DAMAGED = 5
    """wrong check byte or a counter of 15; the next frame is compared with the last undamaged one"""

    @property
    def bad(self) -> bool:
        """Whether the frame counts against the sender."""
        return self >= Verdict.REPEATED


@dataclass
class E2eMonitor:
    """Follows one message; `damaged` to `lost` count frames, `stuck` how often the counter stood still."""

    damaged: int = 0
    repeated: int = 0
    jumped: int = 0
    lost: int = 0
    stuck: int = 0
    _last: int | None = None
    _repeats: int = 0
    _bad: deque[bool] = field(default_factory=lambda: deque(maxlen=WINDOW))

    def take(self, intact: bool, counter: int) -> Verdict:
        """Take one received frame; the verdict on it."""
        verdict = self._judge(intact, counter)
        if verdict is not Verdict.DAMAGED:
            self._last = counter
        self._repeats = self._repeats + 1 if verdict is Verdict.REPEATED else 0
        self.stuck += self._repeats == STUCK_AFTER
        self._bad.append(verdict.bad)
        return verdict

    @property
    def trusted(self) -> bool:
        """Whether the sender can be trusted: an undamaged frame came, and few of the last ones were bad."""
        return self._last is not None and sum(self._bad) < BAD_LIMIT

    def _judge(self, intact: bool, counter: int) -> Verdict:
        if not intact or not 0 <= counter < COUNTERS:
            self.damaged += 1
            return Verdict.DAMAGED
        if self._last is None:
            return Verdict.FIRST
        step = (counter - self._last) % COUNTERS
        if step == 0:
            self.repeated += 1
            return Verdict.REPEATED
        if step > 1 + LOST_MAX:
            self.jumped += 1
            return Verdict.JUMPED
        self.lost += step - 1
        return Verdict.GOOD if step == 1 else Verdict.LOST


LOG = logging.getLogger("inkloop_hardware")
LOST_AFTER = 0.3
"""Seconds without a status, unless configured: three cycles."""
OFF = (State.SAFE, State.FAULT)


@dataclass
class NodeWatch:
    """Follows the status and fault frames of one node and logs each change once.

    silence_s: seconds without a status until it is lost. status, at: the last intact one and its second; falls: how
    often the node took its de-energised state; fault: why.
    """

    node: Node
    silence_s: float = LOST_AFTER
    status: NodeStatus | None = None
    at: float | None = None
    falls: int = 0
    fault: Fault = Fault.NONE
    monitor: E2eMonitor = field(default_factory=E2eMonitor)
    _off: bool = True
    _logged: str = ""

    def take_status(self, now: float, status: NodeStatus | None, counter: int) -> None:
        """Take a status frame; None: a damaged one."""
        verdict = self.monitor.take(status is not None, counter)
        if status is None or verdict.bad:
            return
        if self.status is not None and status.boot_count != self.status.boot_count:
            LOG.warning("%s: restarted", self.node.lower())
        self.status, self.at = status, now
        self._turn(status.state in OFF, status.fault)
        self._log(sentence(self.node, status), level_of(status.state))

    def take_fault(self, fault: NodeFault) -> None:
        """Take a fault frame; it precedes the status with the same fault."""
        if fault.fault is not Fault.NONE:
            self._turn(True, fault.fault)

    def trouble(self, now: float) -> str | None:
        """Message with the reason why the node cannot be used at this second, None if it can."""
        name = self.node.lower()
        if self.at is None:
            return f"the {name} has sent no status"
        if not self.monitor.trusted:
            return (
                f"the {name} cannot be trusted: of its frames {self.monitor.damaged} were damaged, "
                f"{self.monitor.repeated} repeated, {self.monitor.jumped} jumped; do two nodes use its ids?"
            )
        if now - self.at > self.silence_s:
            return f"the {name} has been silent for {now - self.at:.1f} s; is it powered, and the cable plugged in?"
        return None

    def _turn(self, off: bool, fault: Fault) -> None:
        self.falls += off and not self._off
        self._off, self.fault = off, fault

    def _log(self, message: str, level: int) -> None:
        if message != self._logged:
            LOG.log(level, "%s", message)
        self._logged = message


def level_of(state: State) -> int:
    """Level of the log line of a state: the states of a step are logged by the step itself, a fault is a warning."""
    if state is State.FAULT:
        return logging.WARNING
    return logging.INFO if state in (State.SAFE, State.IDLE) else logging.DEBUG


def sentence(node: Node, status: NodeStatus) -> str:
    """A status as a sentence: "head: pass 2 of layer 7"."""
    jetted = status.pass_mask.bit_count()
    state = {
        State.SAFE: "off" + because(status.fault),
        State.IDLE: "idle",
        State.RECEIVING: "receiving a pattern",
        State.VERIFIED: f"pattern of layer {status.layer} verified",
        State.PRINTING: f"pass {jetted + 1} of layer {status.layer}",
        State.PRINTED: f"{jetted} {'pass' if jetted == 1 else 'passes'} of layer {status.layer} jetted",
        State.CURING: "lamp on" if status.lamp_on else "curing",
        State.CURED: "cured",
        State.SCANNING: "scanning",
        State.MAP_READY: "map ready",
        State.FAULT: "fault" + because(status.fault),
    }[status.state]
    return f"{node.lower()}: {state}"


def because(fault: Fault) -> str:
    """ " (gate not confirmed)", nothing without a fault."""
    return f" ({fault.name.lower().replace('_', ' ')})" if fault else ""


OVER_AFTER = 0.5
"""Seconds without such a frame after which its sender counts as gone."""
HEARD_OFTEN = 2
"""Frames of another master that make it one; a single one may be the last of a run that just ended."""


@dataclass
class BusWatch:
    """Follows MasterAlive and StopRequest of others and logs each change once. session: our own."""

    session: int
    other: int | None = None
    other_at: float = 0.0
    heard: int = 0
    stop: Source | None = None
    stop_at: float = 0.0

    def take_master(self, now: float, alive: MasterAlive) -> None:
        """Take a MasterAlive of the bus."""
        if alive.session == self.session:
            return
        is_new = self.other != alive.session or now - self.other_at > OVER_AFTER
        self.heard = 1 if is_new else self.heard + 1
        if self.heard == HEARD_OFTEN:
            LOG.warning("another master is active on the bus, session %d: nothing is enabled meanwhile", alive.session)
        self.other, self.other_at = alive.session, now

    def take_stop(self, now: float, request: StopRequest) -> None:
        """Take a StopRequest of the bus."""
        if request.active and self.stop is None:
            LOG.warning("a stop request of the %s", request.source.name.lower())
        self.stop, self.stop_at = (request.source if request.active else None), now

    def stop_request(self, now: float) -> str | None:
        """Message about a stop request that is active at this second, None without one."""
        if self.stop is not None and now - self.stop_at <= OVER_AFTER:
            return (
                f"a stop request of the {self.stop.name.lower()} is active: look at the bench, then release it "
                "(`inkloop bench release SCENARIO`, or where it was made) and `inkloop bench clear SCENARIO`"
            )
        return None

    def other_master(self, now: float) -> str | None:
        """Message about another master that is active at this second, None without one."""
        if self.heard >= HEARD_OFTEN and now - self.other_at <= OVER_AFTER:
            return (
                f"another master is active on this bus, session {self.other}: end it (another run, `inkloop bench`, a "
                "tool that sends MasterAlive), then `inkloop bench clear SCENARIO`"
            )
        return None

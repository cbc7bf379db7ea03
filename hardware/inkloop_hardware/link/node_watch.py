"""Watch of one node by its frames: its status, its faults, whether it is alive and can be trusted."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field

from inkloop_hardware.protocol.e2e_monitor import E2eMonitor
from inkloop_hardware.protocol.records import NodeFault, NodeStatus
from inkloop_hardware.protocol.vocabulary import Fault, Node, State

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

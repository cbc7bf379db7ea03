"""Checks and preparation of the nodes before a print or a scan: presence, protocol, clear, home."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence

from inkloop_hardware.errors import HardwareError
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeLimits, NodeState, Roles
from inkloop_hardware.protocol.records import NodeStatus
from inkloop_hardware.protocol.services import Key, Outcome, Routine
from inkloop_hardware.protocol.vocabulary import Fault, Node

ROLES = {Node.HEAD: Roles.HEAD, Node.STAGE: Roles.STAGE, Node.CURE: Roles.CURE, Node.PROFILER: Roles.PROFILER}
NOT_READY = {
    Node.HEAD: ("ink temperature or back pressure", "wait for them, or check ink supply and heater"),
    Node.CURE: ("lamp or gate", "check both"),
    Node.PROFILER: ("its sensor", "check its supply"),
}
"""Causes of a status of a node in which Ready is 0, and what to do; a run homes the stage by itself."""
SETTLING_S, PAUSE_S = 2.0, 0.02  # for the gate to close after a stop, and between two looks (assumed)
AT_ONCE_S = 5.0  # for a routine that moves nothing (assumed)
MARGIN_S = 2.0  # beyond the limit that a node keeps by itself: its own answer comes first (assumed)

_log = logging.getLogger("inkloop_hardware")


class NotReady(HardwareError):
    """Nodes are not ready; the message names all of them, with the remedy for each."""


def make_ready(rig: Rig, nodes: Sequence[Node]) -> dict[Node, NodeLimits]:
    """Wait for the nodes, clear them, home the stage if it is one of them; the limits of each.

    Homing has a key: for the second device of a rig the stage answers "done before", as long as it was not moved.
    Raises NodeLost for missing nodes, NotReady if a person is needed or the protocol differs, HardwareError.
    """
    rig.wait_for(nodes)
    rig.check_alone()
    states = {node: rig.link(node).state() for node in nodes}
    reasons = _foreign(rig, states) or [reason for node, state in states.items() if (reason := blocked(node, state))]
    if reasons:
        raise NotReady("\n".join(reasons))
    if reasons := _missing_at_rest(rig, nodes):
        raise NotReady("\n".join(reasons))
    for node, state in states.items():
        clear(rig, node)
        if state.flags & Flags.DRY_RUN:  # left over: a real layer would be printed without ink
            set_dry_run(rig, node, on=False)
    if Node.STAGE in nodes:
        home(rig)
    return {node: rig.link(node).limits() for node in nodes}


def missing(node: Node, status: NodeStatus | None) -> list[str]:
    """Conditions that the status of a node lacks, each with what to do."""
    found = []
    if status is not None and not status.ready and node in NOT_READY:
        what, advice = NOT_READY[node]
        found.append(f"not ready: {what}; {advice}")
    if status is not None and node in (Node.HEAD, Node.CURE) and not (status.gate_closed or status.gate_open):
        found.append("the gate is not confirmed closed; check the gate and its end switches")
    return found


def _missing_at_rest(rig: Rig, nodes: Sequence[Node]) -> list[str]:
    """Conditions that the nodes lack, each with its node and what to do, once a gate has had time to close."""
    until = time.monotonic() + SETTLING_S
    while True:
        found = [f"{node.lower()}: {reason}" for node in nodes for reason in missing(node, rig.status(node))]
        if not found or time.monotonic() > until:
            return found
        rig.keep_alive()
        time.sleep(PAUSE_S)


def blocked(node: Node, state: NodeState) -> str | None:
    """Message with the reason why a node needs a person, and the remedy; None if it needs none."""
    name = node.lower()
    if state.flags & Flags.STOPPED:
        return f"{name}: a stop request is active; release it, check the bench, then `inkloop bench clear SCENARIO`"
    if state.flags & Flags.JOURNAL_DAMAGED:
        return f"{name}: its journal cannot be written; replace its storage, nothing is energised until then"
    if state.flags & Flags.JOURNAL_UNREADABLE:
        return (
            f"{name}: its journal could not be read at power-up, so what it has done is not known; switch it off and "
            "on; if it is no better then, take the part off, `inkloop bench clear SCENARIO --give-up`, begin a new one"
        )
    if not state.flags & Flags.NEEDS_OPERATOR:
        return None
    if state.unknown:
        passes = ", ".join(str(number + 1) for number in range(4) if state.unknown >> number & 1)
        why = f"pass {passes} of layer {state.layer}, which was begun and whose progress is unknown"
    elif state.layer_flags & LayerFlags.CURE_UNKNOWN:
        why = f"a cure of layer {state.layer}, which was begun and whose duration is unknown; it will be repeated"
    else:
        why = state.cause.name if state.cause != Fault.NONE else "a step that it gave up"
    look = "make room in its storage" if state.cause == Fault.STORAGE_FAILED else "check the bench"
    return f"{name}: needs a person because of {why}; {look}, then `inkloop bench clear SCENARIO`"


def clear(rig: Rig, node: Node, option: int = 0) -> None:
    """Bring a node from SAFE or FAULT to IDLE; option: see `services.ClearOption`."""
    rig.link(node).routine(Routine.CLEAR, Key(rig.job, 0), bytes([option]), limit_s=AT_ONCE_S)


def set_dry_run(rig: Rig, node: Node, *, on: bool) -> None:
    """Switch the dry run of a node: nothing is jetted, lit or recorded."""
    rig.link(node).routine(Routine.DRY_RUN, Key(rig.job, 0), bytes([on]), limit_s=AT_ONCE_S)


def home(rig: Rig) -> None:
    """Home the stage."""
    stage = rig.link(Node.STAGE)
    limit_s = stage.limits().motion + MARGIN_S
    with rig.enabled(motion=True):
        outcome = stage.routine(Routine.HOME, Key(rig.job, 0), limit_s=limit_s)
    if outcome == Outcome.DONE:
        _log.info("stage: at its zero")


def _foreign(rig: Rig, states: dict[Node, NodeState]) -> list[str]:
    """Messages about nodes with another version of the protocol, or with roles that do not fit their ids."""
    expected = Codec().protocol_version
    reasons = []
    for node, state in states.items():
        status = rig.status(node)
        if status and status.protocol_version != expected:
            version = rig.link(node).version()
            reasons.append(
                f"{node.lower()}: has version {status.protocol_version} of the protocol ({version}), this inkloop "
                f"{expected}; update the older of the two"
            )
        elif not state.roles & ROLES[node]:
            reasons.append(f"{node.lower()}: the node at its ids has the roles {state.roles!s}; give it its own ids")
    return reasons

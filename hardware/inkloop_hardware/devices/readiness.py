"""Checks and preparation of the nodes before a print or a scan: presence, protocol, clear, home; recovery in a layer.

A print continues automatically after nodes stopped or were lost if none needs a person: no begun step is unknown then,
and every step is requested again by its key, so that nothing is done twice.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TypeVar

from inkloop_hardware.errors import (
    BusDisconnected,
    HardwareError,
    LinkTimeout,
    NodeLost,
    NodeRefused,
    NodeStopped,
    TransferError,
)
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Flags, LayerFlags, NodeLimits, NodeState, Roles
from inkloop_hardware.protocol.records import Fault, Node, NodeStatus, State
from inkloop_hardware.protocol.services import Key, Outcome, Routine

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
    looks = round(SETTLING_S / PAUSE_S)
    while True:
        found = [f"{node.lower()}: {reason}" for node in nodes for reason in missing(node, rig.status(node))]
        looks -= 1
        if not found or looks <= 0:
            return found
        rig.pause(PAUSE_S)


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
    look = "make room in its storage" if state.cause == Fault.STORAGE_FAILED else "check the bench"
    if state.unknown:
        passes = ", ".join(str(number + 1) for number in range(4) if state.unknown >> number & 1)
        why = f"pass {passes} of layer {state.layer}, which was begun and whose progress is unknown"
    elif state.layer_flags & LayerFlags.CURE_UNKNOWN and state.cause is Fault.LAMP_TIME:
        why = f"a cure of layer {state.layer}, in which the lamp took no current until its end; it will be repeated"
        look = "check lamp, driver and supply"
    elif state.layer_flags & LayerFlags.CURE_UNKNOWN:
        why = f"a cure of layer {state.layer}, which was begun and whose duration is unknown; it will be repeated"
    else:
        why = state.cause.name if state.cause != Fault.NONE else "a step that it gave up"
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


TIMES = 3  # retries of a layer or a scan; a bench that stops more often needs a person (assumed)
REOPENING_S = 20.0  # for a disconnected adapter to be opened again; the bus process gives up before

PASSING = (BusDisconnected, NodeLost, NodeStopped, NodeRefused, LinkTimeout, TransferError)
"""Errors whose cause may be a node or an adapter that was missing for a while, or a node that stopped."""

Found = TypeVar("Found")


def retry_after_recovery(
    rig: Rig, nodes: Sequence[Node], work: Callable[[], Found], *, is_start: bool = False
) -> Found:
    """Return the result of `work`, which is retried after nodes or the adapter were lost, or nodes stopped.

    No retry if a node needs a person; three retries at most. is_start: `work` makes the nodes ready itself. Raises
    HardwareError: that of `work` if no node stopped, NotReady with the cause if a person is needed, NodeLost if a node
    does not come back.
    """
    cause: HardwareError | None = None
    for left in range(TIMES, -1, -1):
        if cause is not None:
            rig.wait_for(nodes, REOPENING_S if isinstance(cause, BusDisconnected) else None)
        try:
            if cause is not None:
                _recover_nodes(rig, nodes, cause, is_start)
            return work()
        except PASSING as error:
            if error is cause or left == 0:
                raise
            cause = error
    raise AssertionError("the last try returns or raises")


def _recover_nodes(rig: Rig, nodes: Sequence[Node], error: HardwareError, is_start: bool) -> None:
    """Clear the nodes and home the stage; raises `error` if that fails, NotReady if a person is needed."""
    states = {node: rig.link(node).state() for node in nodes}
    stopped = [node.lower() for node, state in states.items() if state.state in (State.SAFE, State.FAULT)]
    if not stopped and not isinstance(error, BusDisconnected | NodeLost | NodeStopped | LinkTimeout):
        raise error
    if reasons := [reason for node, state in states.items() if (reason := blocked(node, state))]:
        raise NotReady("\n".join([str(error), *reasons])) from error
    _log.warning("%s", error)
    if is_start:
        return
    _log.warning("%s: no step is unknown, the print continues", ", ".join(stopped) or "all nodes are present again")
    make_ready(rig, nodes)

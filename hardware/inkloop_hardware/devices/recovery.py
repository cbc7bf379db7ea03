"""Recovery of nodes that stopped or were lost in the middle of a layer, and a retry of the layer.

The print continues automatically if no node needs a person: no begun step is unknown then, and every step is requested
again by its key, so that nothing is done twice.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TypeVar

from inkloop_hardware.devices.readiness import NotReady, blocked, make_ready
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
from inkloop_hardware.protocol.vocabulary import Node, State

TIMES = 3  # retries of a layer or a scan; a bench that stops more often needs a person (assumed)
REOPENING_S = 20.0  # for a disconnected adapter to be opened again; the bus process gives up before

PASSING = (BusDisconnected, NodeLost, NodeStopped, NodeRefused, LinkTimeout, TransferError)
"""Errors whose cause may be a node or an adapter that was missing for a while, or a node that stopped."""

Found = TypeVar("Found")
_log = logging.getLogger("inkloop_hardware")


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

"""After a node fell to its de-energised state, or was away, in the middle of a layer: may the print go on by itself?

It may where no node asks for a person: nothing that was begun is unknown then, and every step is asked for again by
its key, so that what was done stays done.
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

TIMES = 3  # that a layer or a scan is gone on with; a bench that falls more often needs a person (assumed)
RETURN_S = 5.0  # for a node to restart, or to be heard again (assumed)
REOPENING_S = 20.0  # for an adapter that is gone to be opened again; the bus process gives up before

PASSING = (BusDisconnected, NodeLost, NodeStopped, NodeRefused, LinkTimeout, TransferError)
"""What a node or an adapter that was away for a while, or fell, may be behind."""

Found = TypeVar("Found")
_log = logging.getLogger("inkloop_hardware")


def retry_after_recovery(
    rig: Rig, nodes: Sequence[Node], work: Callable[[], Found], *, is_start: bool = False
) -> Found:
    """What `work` gives; it is begun again where nodes or the adapter were away, or nodes fell, and no node needs a
    person, three times at most. is_start: `work` makes the nodes ready itself.

    Raises HardwareError: that of `work` where no node fell, NotReady where a person is needed, with the reason of the
    fall, NodeLost where a node does not come back.
    """
    fall: HardwareError | None = None
    for left in range(TIMES, -1, -1):
        if fall is not None:
            rig.wait_for(nodes, REOPENING_S if isinstance(fall, BusDisconnected) else RETURN_S)
        try:
            if fall is not None:
                _recover_nodes(rig, nodes, fall, is_start)
            return work()
        except PASSING as error:
            if error is fall or left == 0:
                raise
            fall = error
    raise AssertionError("the last try returns or raises")


def _recover_nodes(rig: Rig, nodes: Sequence[Node], error: HardwareError, is_start: bool) -> None:
    """Clear the nodes and home the stage; raises `error` where that mends nothing, or what forbids it."""
    states = {node: rig.link(node).state() for node in nodes}
    fallen = [node.lower() for node, state in states.items() if state.state in (State.SAFE, State.FAULT)]
    if not fallen and not isinstance(error, BusDisconnected | NodeLost | NodeStopped | LinkTimeout):
        raise error
    if faults := [fault for node, state in states.items() if (fault := blocked(node, state))]:
        raise NotReady("\n".join([str(error), *faults])) from error
    _log.warning("%s", error)
    if is_start:
        return
    _log.warning("%s: no step is unknown, so the print goes on", ", ".join(fallen) or "all nodes are there again")
    make_ready(rig, nodes)

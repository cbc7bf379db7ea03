"""Commands of a person to a bench without a print: status, clear, home, purge, a dry run. Each yields its output."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass

import numpy as np

from inkloop.component import Job
from inkloop_hardware.devices.first_scan import check_seen
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import MARGIN_S, NotReady, blocked, clear, make_ready, missing, set_dry_run
from inkloop_hardware.devices.readiness import home as find_zero
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.height_map_bytes import read_map
from inkloop_hardware.protocol.node_state import Flags, NodeState
from inkloop_hardware.protocol.records import NodeStatus
from inkloop_hardware.protocol.services import ClearOption, Key, Routine
from inkloop_hardware.protocol.vocabulary import Fault, Node, State

NODES = tuple(Node)
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


def status(rig: Rig) -> Iterator[NodeReport]:
    """A report of each node: state, newest layer, required actions."""
    rig.wait_for(NODES)
    for node in NODES:
        link = rig.link(node)
        yield _report(node, link.state(), link.version(), rig.status(node))


def clear_all(rig: Rig, *, give_up: bool = False) -> Iterator[str]:
    """Release all nodes, as a person who has checked the bench; give_up: the open layer is not to be finished."""
    rig.wait_for(NODES)
    option = ClearOption.OPERATOR | (ClearOption.ABANDON if give_up else ClearOption(0))
    for node in NODES:
        state = rig.link(node).state()
        if state.flags & Flags.JOURNAL_UNREADABLE and not give_up and (reason := blocked(node, state)):
            raise NotReady(reason)
        clear(rig, node, int(option))
        yield f"{node.lower()}: cleared" + (", its open layer is given up" if give_up else "")


def home(rig: Rig) -> Iterator[str]:
    """Have the stage find its zero."""
    rig.wait_for((Node.STAGE,))
    clear(rig, Node.STAGE)
    find_zero(rig)
    yield "stage: at its zero"


def purge(rig: Rig) -> Iterator[str]:
    """Purge the head."""
    rig.wait_for((Node.HEAD,))
    clear(rig, Node.HEAD)
    head = rig.link(Node.HEAD)
    head.routine(Routine.PURGE, Key(rig.job, 0), limit_s=head.limits().motion + MARGIN_S)
    yield "head: purged"


def dry_run(rig: Rig, job: Job, *, cure_ms: int) -> Iterator[str]:
    """One whole layer without jet and lamp: transfer, every move, pass and cure, the scan and its map."""
    limits = make_ready(rig, NODES)
    with ExitStack() as stack:
        for node in NODES:
            set_dry_run(rig, node, on=True)
            stack.callback(set_dry_run, rig, node, on=False)
        steps = LayerSteps(rig, job, limits, cure_ms=cure_ms, dry=True)
        pattern = job.mask.astype(np.int32)
        steps.print_layer(1, pattern)
        passes = f"{job.passes} passes" if job.passes > 1 else "one pass"
        yield f"a layer of {pattern.sum()} droplets in {passes}: all steps went through, nothing was jetted or lit"
        _, valid = read_map(steps.scan(1), job.nx, job.ny)
        yield f"its scan: {job.nx} x {job.ny} cells, {valid.mean():.0%} of them valid"
        check_seen(valid, rig, "the scan")


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

"""Commands of a person to a bench without a print: status, clear, home, purge, a dry run. Each yields lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from inkloop.component import Job
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import MARGIN_S, clear, make_ready, set_dry_run
from inkloop_hardware.devices.readiness import home as find_zero
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.height_map_bytes import read_map
from inkloop_hardware.protocol.node_state import Flags, NodeState
from inkloop_hardware.protocol.services import ClearOption, Key, Routine
from inkloop_hardware.protocol.vocabulary import Fault, Node, State

NODES = tuple(Node)


def status(rig: Rig) -> Iterator[str]:
    """A line for each node: state, newest layer, what it needs."""
    rig.wait_for(NODES)
    for node in NODES:
        link = rig.link(node)
        yield f"{node.lower():8s} {_sentence(link.state())}; {link.version()}"


def clear_all(rig: Rig, *, give_up: bool = False) -> Iterator[str]:
    """Release all nodes, as a person who has checked the bench; give_up: the open layer is not to be finished."""
    rig.wait_for(NODES)
    option = ClearOption.OPERATOR | (ClearOption.ABANDON if give_up else ClearOption(0))
    for node in NODES:
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


def _sentence(state: NodeState) -> str:
    found = state.state.name
    if state.state in (State.SAFE, State.FAULT) and state.cause != Fault.NONE:
        found += f" because of {state.cause.name}"
    if state.passes:
        found += f", layer {state.layer} of job {state.job}: {state.done.bit_count()} of {state.passes} passes done"
    if state.unknown:
        found += f", {state.unknown.bit_count()} unknown"
    conditions = {
        Flags.NEEDS_OPERATOR: "needs a person to clear it",
        Flags.STOPPED: "a stop request is active",
        Flags.DRY_RUN: "in a dry run",
        Flags.JOURNAL_DAMAGED: "its journal is damaged",
        Flags.BY_WATCHDOG: "reset by its watchdog",
    }
    return ", ".join([found, *(condition for flag, condition in conditions.items() if state.flags & flag)])

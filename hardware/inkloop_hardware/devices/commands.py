"""Commands of a person to a bench without a print: clear, home, purge, a dry run. Each yields its output."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np

from inkloop.component import Job
from inkloop_hardware.devices.first_scan import check_seen
from inkloop_hardware.devices.layer_steps import LayerSteps
from inkloop_hardware.devices.readiness import MARGIN_S, clear, make_ready, set_dry_run
from inkloop_hardware.devices.readiness import home as find_zero
from inkloop_hardware.link.rig import Rig
from inkloop_hardware.protocol.height_map_bytes import read_map
from inkloop_hardware.protocol.services import ClearOption, Key, Routine
from inkloop_hardware.protocol.vocabulary import Node

NODES = tuple(Node)


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
        check_seen(valid, rig, "the scan")

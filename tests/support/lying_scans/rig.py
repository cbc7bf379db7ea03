"""Whole prints of the rig: controller, plant and profiler step by step by the layer contract, in memory."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from math import ceil
from typing import Any, TypeAlias

import numpy as np

from inkloop.component import Component, FloatMap, Job, Status
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_COMMAND,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    MEASURED_HEIGHT,
    PATTERN,
    STATUS,
    VALID,
)
from inkloop.units import M_PER_UM, UM_PER_M
from inkloop_controller.controllers import LayerMpcController
from support.lying_scans.case import Case
from support.lying_scans.parts import HEIGHT_UM, job_of
from support.lying_scans.plant import printed, substrate
from support.lying_scans.profiler import Scan, read, shown

SECOND = 1_000_000_000
LAYERS_MAX = 6  # a print is ended after so many times the layers of an open loop
DONE, STOPPED, UNENDED = "done", "stopped", "layers_max"

MakeController: TypeAlias = Callable[[Job], Component]


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a print.

    error: (nx, ny) height above the substrate less target [um]; mae, highest, lowest: of it over the part's cells [um];
    layers: printed; ending: "done", "stopped" (nothing more is commanded, though not done) or "layers_max";
    untrusted_from: the first layer whose scan made the print untrusted (None: none did); reasons: all bits of
    `untrusted_reasons` that were set at any time; outputs: the controller's last ones.
    """

    case: str
    seed: int
    error: FloatMap
    mae: float
    highest: float
    lowest: float
    layers: int
    ending: str
    untrusted_from: int | None
    reasons: int
    outputs: dict[str, Any]


def product(job: Job, **options: object) -> Component:
    """The controller of this project."""
    return LayerMpcController(job, **options)


def print_case(
    case: Case, seed: int, make_controller: MakeController | None = None, layers_max: int | None = None
) -> Outcome:
    """Print a case once; the same case and seed have the same droplets and the same scan errors, in any order.

    make_controller: the controller of a job, with the case's options if not given; layers_max: 6 times the layers of an
    open loop if not given.
    """
    job = job_of(case.part, case.shape, case.ink, case.drop_levels)
    controller = make_controller(job) if make_controller else product(job, **case.options)
    for_plant, for_profiler = np.random.default_rng([seed, zlib.crc32(case.name.encode())]).spawn(2)
    nominal = ceil(HEIGHT_UM / (job.inks[0].layer_height * case.drop_levels * UM_PER_M))
    height, scans = np.zeros(case.shape), list[Scan]()
    reasons, untrusted_from, ending = 0, None, UNENDED
    layer, limit = 0, LAYERS_MAX * nominal if layers_max is None else layers_max
    while True:
        done = min(layer / nominal, 1.0)
        surface = height + substrate(case.plant, case.shape, done)
        scans.append(read(case.profiler, surface, layer, done, for_profiler))
        inputs = _inputs(shown(case.profiler, scans), layer)
        if layer == 0:
            controller.initialize(0, inputs)
        outputs = controller.do_step(layer * SECOND, SECOND, inputs)
        seen = int(outputs.get("untrusted_reasons", 0))
        reasons |= seen
        if untrusted_from is None and (seen or outputs[STATUS] == Status.UNTRUSTED):
            untrusted_from = layer
        if outputs[STATUS] == Status.DONE:
            ending = DONE
        elif outputs[LAYER_COMMAND] == layer or not np.any(outputs[PATTERN]):
            ending = STOPPED
        if ending != UNENDED or layer == limit:
            break
        layer += 1
        drops = np.where(outputs[PATTERN] > 0, outputs[DROP_LEVEL] / case.drop_levels, 0.0)
        height = printed(case.plant, height, drops, layer, min(layer / nominal, 1.0), for_plant)
    controller.terminate()
    error = height - job.target_height * UM_PER_M
    part = error[job.mask]
    figures = (float(np.abs(part).mean()), float(part.max()), float(part.min()))
    return Outcome(case.name, seed, error, *figures, layer, ending, untrusted_from, reasons, dict(outputs))


def print_cases(
    cases: Iterable[Case], seeds: int, processes: int = 1, make_controller: MakeController | None = None
) -> Iterator[Outcome]:
    """Outcomes of the seeds 1 to `seeds` of each case, in this order.

    With more than one process `make_controller` must be a function of a module.
    """
    prints = [(case, seed) for case in cases for seed in range(1, seeds + 1)]
    one = partial(_print_one, make_controller)
    if processes == 1:
        yield from map(one, prints)
        return
    with ProcessPoolExecutor(processes) as pool:
        yield from pool.map(one, prints)


def _print_one(make_controller: MakeController | None, which: tuple[Case, int]) -> Outcome:
    return print_case(*which, make_controller)


def _inputs(scan: Scan, layer: int) -> dict[str, Any]:
    z, valid = scan
    return {
        MEASURED_HEIGHT: z * M_PER_UM,
        VALID: valid,
        LAYERS_SCANNED: np.asarray(layer, np.int32),
        LAYERS_PRINTED: np.asarray(layer, np.int32),
    }

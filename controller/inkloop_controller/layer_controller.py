"""The controller as a component of the loop: a step of the core around any planner."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from math import isfinite, nan
from time import perf_counter
from typing import Any, Literal, TypeAlias

import numpy as np

from inkloop.component import Job, Port, Values
from inkloop.contract import LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, VALID
from inkloop.errors import ComponentError
from inkloop_controller.core.layer_step import Block, LayerStep
from inkloop_controller.core.library import PlanFiguresStruct
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.planning.layer_plan import LayerPlan, Planner, PlanStatus, gap_of
from inkloop_controller.problem.options import errors_of, refuse, variables

OnDoubt: TypeAlias = Literal["stop", "continue"]
"""Consequence of scans that do not show what was printed."""

_MARK = b"inkloop controller state 1\n"


class LayerController:
    """Commands layer k + 1 when layer k is printed and scanned, once per scan, until its planner is done.

    It goes by sequence numbers only, so any master may step it in any order and step size. From a layer that its
    printer calls unknown it takes the scan and learns nothing. A print that it has stopped goes on in the step in which
    `looked_at` is true. The step is that of controller/core/step/layer_step.h; inputs and outputs are those of
    LayerController.fmu, what a bound is worth, and of a planner of several layers `planned_droplets`: droplets of the
    plan on each cell, those of the commanded layer among them.
    """

    def __init__(self, job: Job, planner: Planner, estimator: HeightEstimator, on_doubt: OnDoubt = "stop") -> None:
        refuse(errors_of(on_doubt=on_doubt))
        self._planner, self._estimator, self._layers = planner, estimator, getattr(planner, "horizon", 1)
        self._state: Block
        self._outputs: Values | None
        self._step = LayerStep(job, on_doubt=on_doubt, **estimator.options)
        shape = self._step.shape
        self.inputs = tuple(each.port(shape) for each in variables().values() if each.causality == "input")
        self.outputs = (
            *(_without_bound(each.port(shape)) for each in variables().values() if each.causality == "output"),
            Port("bound_confidence", start=1.0),
            Port("gap", start=nan),
            *([Port("planned_droplets", shape=shape, dtype="int8")] if self._layers > 1 else []),
        )
        self._begin_again(0)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Start again; commands count from the number of layers printed by now."""
        self._begin_again(int(inputs[LAYERS_PRINTED]))
        return self._shown()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Answer a new scan of the layer commanded last, or the scan that stopped the print, once a person has looked.

        Raises ComponentError for a scan of another shape, for heights that are not finite or beyond the limits of
        measured_height, and for a first scan with hardly a reading; the state is then as before.
        """
        if self._step.is_due(inputs, self._state):
            self._answer(inputs)
        return self._shown()

    def terminate(self) -> None:
        """Nothing is held open."""

    def save(self) -> bytes:
        """The whole state, bit by bit."""
        block = self._state.tobytes()
        return _MARK + zlib.crc32(block).to_bytes(4, "big") + block

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ComponentError if it belongs to another grid or is none."""
        begin = len(_MARK) + 4
        if saved[: len(_MARK)] != _MARK or zlib.crc32(saved[begin:]).to_bytes(4, "big") != saved[len(_MARK) : begin]:
            raise ComponentError(
                "layer controller: what is to be restored is no state of it: it is damaged, or of another version of "
                "inkloop; begin the print again, or take that version"
            )
        state = np.frombuffer(bytearray(saved[begin:]), np.uint8)
        if not self._step.layers_of(state):
            nx, ny = state[:16].view(np.uint64)
            raise ComponentError(
                f"layer controller: the state to be restored is of a grid ({nx}, {ny}); needs {self._step.shape}"
            )
        self._state, self._outputs = state, None

    def _begin_again(self, layers_printed: int) -> None:
        self._state, self._outputs = self._step.new_state(self._layers, layers_printed), None

    def _answer(self, inputs: Mapping[str, Any]) -> None:
        scanned, scan = perf_counter(), int(inputs[LAYERS_SCANNED])
        try:
            measured, valid = self._estimator.scan(inputs[MEASURED_HEIGHT], inputs[VALID])
            state, lacks_plan = self._step.begin(measured, valid, self._state)
        except ValueError as error:
            raise ComponentError(f"layer controller: scan {scan}: {error}") from None
        self._state, self._outputs = state, None  # where planning fails, it is begun again from the estimate
        if lacks_plan:
            estimate, last = self._estimator.estimate(self._step.estimate_in(state)), self._step.plan_in(state)
            plan = self._planner.plan(estimate, scan, last, perf_counter() - scanned)
            self._state = self._step.take(state, plan.plan, _figures_of(plan, perf_counter() - scanned))

    def _shown(self) -> Values:
        """The outputs of the state, made once."""
        if self._outputs is None:
            figures, outputs = self._step.figures_in(self._state), dict(self._step.outputs(self._state))
            if not outputs["bound_valid"]:
                outputs["bound"] = np.asarray(nan)
            outputs["bound_confidence"] = np.asarray(figures.bound_confidence)
            outputs["gap"] = np.asarray(gap_of(figures.objective.value, figures.bound))
            if self._layers > 1:
                outputs["planned_droplets"] = np.count_nonzero(self._step.plan_in(self._state), axis=0).astype(np.int8)
            self._outputs = outputs
        return dict(self._outputs)


def controller_as_read(job: Job, planner: Planner) -> LayerController:
    """The controller around a planner that takes ink and scans as they are."""
    return LayerController(job, planner, HeightEstimator(job, adapt_ink="off", take_as_read=True))


def _without_bound(port: Port) -> Port:
    """Without a bound there is no number for it."""
    return Port(port.name, port.unit, port.shape, port.dtype, nan) if port.name == "bound" else port


def _figures_of(plan: LayerPlan, seconds: float) -> Any:
    found = plan.objective
    return PlanFiguresStruct(
        status=list(PlanStatus).index(plan.status),
        left_out=int(plan.left_out),
        sweeps=plan.sweeps,
        objective=(found.value, found.error, found.over_ceiling, found.deviation),
        bound=plan.bound if isfinite(plan.bound) else nan,
        bound_confidence=plan.bound_confidence,
        seconds=seconds,
    )

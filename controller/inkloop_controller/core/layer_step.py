"""One step of the controller in C (controller/core/step/layer_step.h), for a job with options."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, Job, Values
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_UNKNOWN,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    LOOKED_AT,
    MEASURED_HEIGHT,
    VALID,
)
from inkloop.errors import InkloopError
from inkloop.geometry import Columns
from inkloop_controller.core.bindings import answered
from inkloop_controller.core.library import PlanFiguresStruct, StepStruct, library
from inkloop_controller.problem.arrays import checked, pointer
from inkloop_controller.problem.horizon_problem import IntPlan
from inkloop_controller.problem.options import variables

Block = NDArray[np.uint8]
"""Bytes of a state, or of an estimate."""

_PLAN = 1  # STEP_PLAN: the state lacks a plan


class LayerStep:
    """The variables of a controller: the values of all of them, where C finds them.

    options: values by the names of variables.toml; None, and infinity where that means none: the start value. threads
    and take_as_read: see LayerStep in controller/core/step/step_options.h.
    """

    def __init__(
        self,
        job: Job,
        *,
        jettable: BoolMap | None = None,
        columns: Columns | None = None,
        threads: int = 1,
        take_as_read: bool = False,
        **options: Any,
    ) -> None:
        if len(variables()) != library().inkloop_variables():
            raise InkloopError("variables.toml is not of the same build as the core; run make, or pip install again")
        self.shape = job.nx, job.ny
        self._places = {name: place for place, name in enumerate(variables())}
        self._pointers = (ctypes.c_void_p * len(variables()))()
        self._values: dict[str, NDArray[Any]] = {}
        for name, each in variables().items():
            self._point(name, np.array(each.start, each.dtype))
        for name, value in {**_of_job(job), **options}.items():
            self.set(name, value)
        self._point("target_height", np.ascontiguousarray(job.target_height))
        self._point("mask", np.ascontiguousarray(job.mask))
        self._point("jettable", np.ascontiguousarray(job.mask if jettable is None else jettable))
        region = () if columns is None else (columns.offsets, columns.bottoms, columns.tops)
        self._region = [np.ascontiguousarray(each) for each in region]  # C looks there as long as the step lives
        places = [pointer(each) for each in self._region] or [None] * 3
        self.struct = StepStruct(ctypes.addressof(self._pointers), *places, threads, take_as_read)

    def set(self, name: str, value: Any) -> None:
        """Gives a variable another value."""
        self._values[name][...] = variables()[name].number(value)

    def new_estimate(self) -> Block:
        """Memory for C to write an estimate."""
        return np.zeros(self.estimate_size, np.uint8)

    def new_state(self, layers: int, layers_printed: int) -> Block:
        """The state before the first scan, with room for a plan of `layers`."""
        state = self._room(layers)
        library().inkloop_state_start(self.struct, layers, layers_printed, pointer(state))
        return state

    def layers_of(self, state: Block) -> int:
        """Layers of the plan in a state; 0 if it is none of this grid."""
        return int(library().inkloop_state_layers(self.struct, pointer(state), state.size))

    def estimate_in(self, state: Block) -> Block:
        """The estimate in a state, where it lies."""
        head = library().inkloop_state_head_size()
        return state[head : head + self.estimate_size]

    def plan_in(self, state: Block) -> IntPlan:
        """The last plan in a state (layers, nx, ny), where it lies."""
        behind = library().inkloop_state_head_size() + self.estimate_size
        return state[behind:].view(np.int32).reshape(-1, *self.shape)

    @property
    def estimate_size(self) -> int:
        """Of an estimate [bytes]."""
        return int(library().inkloop_estimate_size(self.shape[0] * self.shape[1]))

    def figures_in(self, state: Block) -> Any:
        """The PlanFigures of the last plan."""
        figures = PlanFiguresStruct()
        library().inkloop_state_plan(pointer(state), figures)
        return figures

    def is_due(self, inputs: Mapping[str, Any], state: Block) -> bool:
        """Whether these inputs, by name, ask for anything; those that are not given have their start value."""
        for name in (LAYERS_SCANNED, LAYERS_PRINTED, LAYER_UNKNOWN, LOOKED_AT):
            self.set(name, inputs.get(name))
        return bool(library().inkloop_step_is_due(self.struct, pointer(state)))

    def begin(self, measured: NDArray[Any], valid: NDArray[Any], before: Block) -> tuple[Block, bool]:
        """The state after the scan of a step that is due, and whether it lacks a plan."""
        self._point(MEASURED_HEIGHT, measured)
        self._point(VALID, valid)
        after = np.empty_like(before)
        code = answered(library().inkloop_step_begin(self.struct, pointer(before), pointer(after)))
        return after, code == _PLAN

    def take(self, state: Block, plan: IntPlan, figures: Any) -> Block:
        """The state with a plan (layers, nx, ny): the same one, changed, or another one for as many layers.

        figures: PlanFiguresStruct. Raises ValueError for a plan of another grid, or of no layer.
        """
        layers = max(1, len(plan))
        droplets = checked("plan", plan, "i4", (layers, *self.shape))
        after = state if self.layers_of(state) == layers else self._room(layers)
        library().inkloop_step_take(self.struct, pointer(state), pointer(droplets), layers, figures, pointer(after))
        return after

    def outputs(self, state: Block) -> Values:
        """The outputs of a state by name, in arrays of their own."""
        found = {
            name: np.empty(self.shape if each.shape == "grid" else (), each.dtype)
            for name, each in variables().items()
            if each.causality == "output"
        }
        for name, place in found.items():
            self._pointers[self._places[name]] = place.ctypes.data
        library().inkloop_step_outputs(self.struct, pointer(state))
        if (found[DROP_LEVEL] == 1).all():  # of most prints: a map without memory of its own
            found[DROP_LEVEL] = np.broadcast_to(np.int32(1), self.shape)
        return {name: value.astype(np.int32) if variables()[name].items else value for name, value in found.items()}

    def _room(self, layers: int) -> Block:
        return np.empty(library().inkloop_state_size(self.shape[0] * self.shape[1], layers), np.uint8)

    def _point(self, name: str, value: NDArray[Any]) -> None:
        """The variable of this name lies here."""
        self._values[name] = value
        self._pointers[self._places[name]] = value.ctypes.data


def _of_job(job: Job) -> dict[str, Any]:
    return {
        "nx": job.nx,
        "ny": job.ny,
        "pitch": job.pitch,
        "inks": len(job.inks),
        "has_region": job.region is not None,
        **{f"{h}_a": getattr(job.inks[0], h) for h in ("h1", "h2", "h3")},
        **{f"{h}_b": getattr(job.inks[-1], h) for h in ("h1", "h2", "h3")},
        "passes": job.passes,
        "pass_order": job.pass_order,
        "pass_rotation": job.pass_rotation,
        "seed": np.uint32(job.seed % 2**32).astype(np.int32),
        "is_timed": True,
    }

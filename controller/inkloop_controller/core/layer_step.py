"""One step of the controller in C (controller/core/step/layer_step.h), for a job with options."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from inkloop.component import BoolMap, Ink, Job, Values
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
from inkloop_controller.core.bindings import answered, laid_out, pointer
from inkloop_controller.core.library import library
from inkloop_controller.core.structs import LayerStepStruct, PlanFiguresStruct
from inkloop_controller.problem.horizon_problem import IntPlan
from inkloop_controller.problem.variables import variables

Block = NDArray[np.uint8]
"""Bytes of a state, or of an estimate."""

_PLAN = 1  # STEP_PLAN: the state lacks a plan


class LayerStep:
    """What a controller works on: the values of all variables, where C finds them.

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
        self._made_of = {"job": job, "jettable": jettable, "columns": columns, "threads": threads, **options}
        self._made_of["take_as_read"] = take_as_read
        everywhere = job.mask if jettable is None else jettable
        self._values = {name: np.array(each.start, each.dtype) for name, each in variables().items()}
        for name, value in {**_of_job(job), **options}.items():
            self._values[name][...] = variables()[name].number(value)
        for name, map_ in (("target_height", job.target_height), ("mask", job.mask), ("jettable", everywhere)):
            self._values[name] = np.ascontiguousarray(map_)
        region = (None, None, None) if columns is None else (columns.offsets, columns.bottoms, columns.tops)
        self._pointers = (ctypes.c_void_p * len(variables()))()
        self._places = {name: place for place, name in enumerate(variables())}
        for name in self._values:
            self._point(name)
        columns_of_region = [None if each is None else pointer(np.ascontiguousarray(each)) for each in region]
        self.struct = LayerStepStruct(ctypes.addressof(self._pointers), *columns_of_region, threads, take_as_read)

    def with_options(self, **options: Any) -> LayerStep:
        """Another one with some other values."""
        return LayerStep(**{**self._made_of, **options})

    def set(self, name: str, value: Any) -> None:
        """Gives a variable another value."""
        self._values[name][...] = variables()[name].number(value)

    def new_state(self, layers: int, layers_printed: int) -> Block:
        """The state before the first scan, with room for a plan of `layers`."""
        state = np.empty(self._size(layers), np.uint8)
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

    def figures_in(self, state: Block) -> PlanFiguresStruct:
        """What is reported of the last plan."""
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
        self._values[MEASURED_HEIGHT], self._values[VALID] = measured, valid
        for name in (MEASURED_HEIGHT, VALID):
            self._point(name)
        after = np.empty_like(before)
        code = answered(library().inkloop_step_begin(self.struct, pointer(before), pointer(after)))
        return after, code == _PLAN

    def take(self, state: Block, plan: IntPlan, figures: PlanFiguresStruct) -> Block:
        """The state with a plan (layers, nx, ny): the same one, changed, or another one for as many layers.

        Raises ValueError for a plan of another grid, or of no layer.
        """
        layers = max(1, len(plan))
        droplets = laid_out("plan", plan, "i4", (layers, *self.shape))
        after = state if self.layers_of(state) == layers else np.empty(self._size(layers), np.uint8)
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
        return found

    def _size(self, layers: int) -> int:
        return int(library().inkloop_state_size(self.shape[0] * self.shape[1], layers))

    def _point(self, name: str) -> None:
        self._pointers[self._places[name]] = self._values[name].ctypes.data


def _of_job(job: Job) -> dict[str, Any]:
    first, last = job.inks[0], job.inks[-1]
    return {
        "nx": job.nx,
        "ny": job.ny,
        "pitch": job.pitch,
        "inks": len(job.inks),
        "has_region": job.region is not None,
        **_heights("a", first),
        **_heights("b", last),
        "passes": job.passes,
        "pass_order": job.pass_order,
        "pass_rotation": job.pass_rotation,
        "seed": np.uint32(job.seed % 2**32).astype(np.int32),
    }


def _heights(material: str, ink: Ink) -> dict[str, float]:
    return {f"h1_{material}": ink.h1, f"h2_{material}": ink.h2, f"h3_{material}": ink.h3}

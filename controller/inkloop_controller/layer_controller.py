"""The controller as a component of the loop: the handshake of the layer contract around any planner."""

from __future__ import annotations

import io
from dataclasses import dataclass, fields, replace
from math import isfinite, nan
from time import perf_counter
from typing import Any, Literal, TypeAlias

import numpy as np

from inkloop.component import BoolMap, FloatMap, Job, Port, Status, Values
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_COMMAND,
    LAYER_UNKNOWN,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    LOOKED_AT,
    MEASURED_HEIGHT,
    PATTERN,
    STATUS,
    STOP_REASON,
    VALID,
    contract_ports,
)
from inkloop.errors import ComponentError
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.planning.layer_plan import Planner, PlanStatus
from inkloop_controller.problem.arrays import is_finite
from inkloop_controller.problem.horizon_problem import IntMap, IntPlan

OnDoubt: TypeAlias = Literal["stop", "continue"]
"""What follows where the scans do not show what was printed."""

HIGHEST = 1.0
"""Heights of a scan lie within it [m]: no printed part is as high, and one in another unit is higher."""
_DISPLACEMENTS = ("shift_x", "shift_y", "shift_std", "spot_radius", "spot_std")


@dataclass(frozen=True, eq=False)
class _State:
    """All that a step leaves for the next one, and for the outputs."""

    plan: IntPlan
    pattern: IntMap
    drop_level: IntMap
    layer_command: int
    estimated: int  # number of the scan that the estimate is of; -1: none
    answered: int  # number of the scan that the last plan was made from; -1: none
    status: int
    objective: float
    objective_error: float
    objective_deviation: float
    bound: float
    bound_valid: bool
    bound_confidence: float
    gap: float
    plan_status: int
    solve_time: float
    sweeps: int
    estimate: Estimate
    left_out: int = 0


class LayerController:
    """Commands layer k + 1 when layer k is printed and scanned, once per scan, until its planner is done.

    It goes by sequence numbers only, so any master may step it in any order and step size. From a layer that its
    printer calls unknown it takes the scan and learns nothing. A print that it has stopped goes on in the step in which
    `looked_at` is true.
    """

    def __init__(self, job: Job, planner: Planner, estimator: HeightEstimator, on_doubt: OnDoubt = "stop") -> None:
        if on_doubt not in ("stop", "continue"):
            raise ValueError(f'on_doubt is {on_doubt!r}; needs "stop" or "continue"')
        shape, self._on_doubt = (job.nx, job.ny), on_doubt
        self._job, self._planner, self._estimator = job, planner, estimator
        signals = (MEASURED_HEIGHT, VALID, LAYERS_SCANNED, LAYERS_PRINTED, LAYER_UNKNOWN, LOOKED_AT)
        self.inputs = contract_ports(shape, *signals)
        self.outputs = (
            *contract_ports(shape, PATTERN, DROP_LEVEL, LAYER_COMMAND, STATUS),
            Port("objective", "m"),
            Port("objective_error", "m"),
            Port("objective_deviation", "m"),
            Port("bound", "m", start=nan),
            Port("bound_valid", dtype="bool"),
            Port("bound_confidence", start=1.0),
            Port("gap", start=nan),
            Port("plan_status", dtype="int32"),
            Port("solve_time", "s"),
            Port("sweeps", dtype="int32"),
            Port("left_out", dtype="int32"),
            Port("estimated_height", "m", shape),
            Port("volume_scale"),
            Port("untrusted_cells", dtype="int32"),
            Port("dead_cells", dtype="int32"),
            Port("capped_cells", dtype="int32"),
            Port("untrusted_reasons", dtype="int32"),
            Port("blind_share"),
            Port("ground_offset", "m"),
            Port("ground_rise_x", "m"),
            Port("ground_rise_y", "m"),
            Port("scan_surprise", start=1.0),
            Port("ink_excess", "m"),
            Port("ink_excess_i", dtype="int32"),
            Port("ink_excess_j", dtype="int32"),
            Port("height_excess", "m"),
            Port("height_excess_i", dtype="int32"),
            Port("height_excess_j", dtype="int32"),
            Port("scan_corrected", dtype="bool"),
            *(Port(f"scan_{name}", "m") for name in _DISPLACEMENTS),
            Port("scan_rotation", "rad"),
            Port("scan_magnification"),
            *contract_ports(shape, STOP_REASON),
            Port("stop_layer", dtype="int32"),
            Port("stop_transform", dtype="int32"),
            Port("stop_figure"),
        )
        self._state = _start(job, 0)

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Start again; commands count from the number of layers printed by now."""
        self._state = _start(self._job, int(inputs[LAYERS_PRINTED]))
        return self._outputs()

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Answer a new scan of the layer commanded last, or the scan that stopped the print, once a person has looked.

        Raises ComponentError for a scan of another shape, and for heights that are not finite or beyond HIGHEST; the
        state is then as before.
        """
        if bool(inputs.get(LOOKED_AT, False)) and self._is_stopped():
            self._trust_again()
        scanned, printed = int(inputs[LAYERS_SCANNED]), int(inputs[LAYERS_PRINTED])
        if self._is_new(scanned, printed):
            is_unknown = bool(inputs.get(LAYER_UNKNOWN, False))
            self._answer(scanned, inputs[MEASURED_HEIGHT], inputs[VALID], is_unknown)
        return self._outputs()

    def terminate(self) -> None:
        """Nothing is held open."""

    def save(self) -> bytes:
        """The whole state, bit by bit, as NumPy's npz; without a pattern that is the plan's, and with one drop for all
        sites where all have the same.
        """
        state: dict[str, Any] = {name: value for name, value in vars(self._state).items() if name != "estimate"}
        if self._state.pattern.ctypes.data == self._state.plan.ctypes.data:
            del state["pattern"]
        if not any(self._state.drop_level.strides):
            state[DROP_LEVEL] = self._state.drop_level[0, 0]
        buffer = io.BytesIO()
        np.savez(buffer, **state | dict(self._state.estimate.state))
        return buffer.getvalue()

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ComponentError if it belongs to another grid or is none."""
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as arrays:
                found = {name: array if array.ndim else array.item() for name, array in arrays.items()}
            if "pattern" not in found:
                found["pattern"] = found["plan"][0]
            if np.ndim(found[DROP_LEVEL]) == 0:
                found[DROP_LEVEL] = np.full(found["pattern"].shape, found[DROP_LEVEL], np.int32)
            own = {field.name for field in fields(_State)}
            known = {name: found.pop(name) for name in found.keys() - own}
            estimate = self._estimator.restored(known) if known else _start(self._job, 0).estimate
            whole = _State(**found, estimate=estimate)
            state = replace(whole, drop_level=_lean(whole.drop_level))
        except (ValueError, TypeError, KeyError, OSError) as error:
            raise ComponentError(f"layer controller: what is to be restored is no state of it ({error})") from error
        if state.pattern.shape != self._state.pattern.shape:
            raise ComponentError(
                f"layer controller: the state to be restored is of a grid {state.pattern.shape}; "
                f"needs {self._state.pattern.shape}"
            )
        self._state = state

    def _trust_again(self) -> None:
        """The last scan is to be answered again, by a plan from what was predicted where it was not believed."""
        state = self._state
        estimate = self._estimator.trust_again(state.estimate)
        self._state = replace(state, estimate=estimate, answered=state.answered - 1, status=int(Status.IDLE))

    def _is_stopped(self) -> bool:
        """Whether the scans do not show what was printed, and that ends the print."""
        return self._on_doubt == "stop" and bool(self._state.estimate.figures.stop)

    def _is_new(self, scanned: int, printed: int) -> bool:
        """Whether the scan is of the layer commanded last, and has not been answered."""
        state = self._state
        is_asked = state.status != Status.DONE and scanned == printed == state.layer_command
        return is_asked and scanned > state.answered

    def _answer(self, scan: int, measured: FloatMap, valid: BoolMap, is_unknown: bool) -> None:
        scanned = perf_counter()
        _check_scan(scan, measured, valid, self._state.pattern.shape)
        if self._state.estimated < scan:  # where planning has failed it is begun again from the estimate
            self._state = replace(
                self._state, estimate=self._estimate(scan, measured, valid, is_unknown), estimated=scan
            )
        before = self._state  # that before the estimate is no longer in memory
        estimate = before.estimate
        if self._is_stopped():
            nothing = np.zeros_like(before.pattern)
            self._state = replace(before, pattern=nothing, answered=scan, status=int(Status.UNTRUSTED))
            return
        plan = self._planner.plan(estimate, scan, before.plan, perf_counter() - scanned)
        done = plan.status is PlanStatus.DONE
        self._state = replace(
            before,
            estimate=estimate,
            plan=plan.plan,
            pattern=plan.pattern,
            drop_level=_lean(np.maximum(plan.drop_level, 1)),
            layer_command=before.layer_command if done else before.layer_command + 1,
            answered=scan,
            status=int(Status.DONE if done else Status.UNTRUSTED if estimate.figures.reasons else Status.IDLE),
            objective=plan.objective.value,
            objective_error=plan.objective.error,
            objective_deviation=plan.objective.deviation,
            bound=plan.bound,
            bound_valid=isfinite(plan.bound),
            bound_confidence=plan.bound_confidence,
            gap=plan.gap,
            plan_status=list(PlanStatus).index(plan.status),
            solve_time=perf_counter() - scanned,
            sweeps=plan.sweeps,
            left_out=int(plan.left_out),
        )

    def _estimate(self, scan: int, measured: FloatMap, valid: BoolMap, is_unknown: bool) -> Estimate:
        """What is known after a scan."""
        before = self._state
        if before.estimated < 0:
            return self._estimator.first(measured, valid, scan)
        drops = before.drop_level.astype(np.float64) if (before.drop_level != 1).any() else None
        seen = (before.estimate, before.pattern, scan, measured, valid, drops)
        return self._estimator.next(*seen, is_unknown=is_unknown)

    def _outputs(self) -> Values:
        estimate, figures, ny = self._state.estimate, self._state.estimate.figures, self._job.ny
        values = {
            **vars(self._state),
            "estimated_height": estimate.height,
            "volume_scale": figures.volume,
            "untrusted_cells": figures.unseen_cells,
            "dead_cells": figures.dead_cells,
            "capped_cells": figures.capped_cells,
            "untrusted_reasons": figures.reasons,
            "blind_share": figures.blind_share,
            **dict(zip(("ground_offset", "ground_rise_x", "ground_rise_y"), figures.ground, strict=True)),
            "scan_surprise": figures.surprise,
            "ink_excess": figures.excess,
            "ink_excess_i": figures.excess_cell // ny,
            "ink_excess_j": figures.excess_cell % ny,
            "height_excess": figures.rise,
            "height_excess_i": figures.rise_cell // ny,
            "height_excess_j": figures.rise_cell % ny,
            "scan_corrected": figures.is_displaced,
            **{f"scan_{name}": self._job.pitch * getattr(figures, name) for name in _DISPLACEMENTS},
            "scan_rotation": figures.rotation,
            "scan_magnification": figures.magnification,
            "stop_reason": figures.stop if self._is_stopped() else 0,
            "stop_layer": figures.stop_layer,
            "stop_transform": figures.transform,
            "stop_figure": figures.stop_figure,
        }
        return {port.name: np.asarray(values[port.name], port.dtype) for port in self.outputs}


def _start(job: Job, layer_command: int) -> _State:
    shape = (job.nx, job.ny)
    return _State(
        plan=np.zeros((1, *shape), np.int32),
        pattern=np.zeros(shape, np.int32),
        drop_level=_lean(np.ones(shape, np.int32)),
        layer_command=layer_command,
        estimated=-1,
        answered=-1,
        status=int(Status.IDLE),
        objective=0.0,
        objective_error=0.0,
        objective_deviation=0.0,
        bound=nan,
        bound_valid=False,
        bound_confidence=1.0,
        gap=nan,
        plan_status=0,
        solve_time=0.0,
        sweeps=0,
        estimate=Estimate.exact(np.zeros(shape), job.inks),
    )


def _lean(drop_level: IntMap) -> IntMap:
    """The same drops per site; a map of ones without memory of its own."""
    return np.broadcast_to(np.int32(1), drop_level.shape) if (drop_level == 1).all() else drop_level


def _check_scan(scan: int, measured: FloatMap, valid: BoolMap, shape: tuple[int, ...]) -> None:
    for name, map_ in ((MEASURED_HEIGHT, measured), (VALID, valid)):
        if map_.shape != shape:
            raise ComponentError(f"layer controller: {name} of scan {scan} has shape {map_.shape}; needs {shape}")
    if is_finite(measured) and measured.min() >= -HIGHEST and measured.max() <= HIGHEST:
        return
    wrong = valid & ~(np.abs(measured) <= HIGHEST)
    if wrong.any():
        i, j = (int(index) for index in np.argwhere(wrong)[0])
        raise ComponentError(
            f"layer controller: measured_height is {measured[i, j]:g} at cell ({i}, {j}) of scan {scan}, which is "
            f"marked valid; needs a height in metres, within {HIGHEST:g} m, or valid = false"
        )

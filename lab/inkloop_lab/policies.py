"""A policy as controller, and a controller as policy: observations, actions, and the handshake around them."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import Component, Job, Status, Values
from inkloop.contract import (
    DROP_LEVEL,
    LAYER_COMMAND,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    MEASURED_HEIGHT,
    PATTERN,
    STATUS,
    STOP_REASON,
    VALID,
    contract_ports,
)
from inkloop.errors import ComponentError

TARGET, MASK = "target", "mask"
Observation: TypeAlias = Mapping[str, NDArray[Any]]
"""`measured_height`, `target` [m] as float64, `valid`, `mask` as int8, 0 or 1; each (nx, ny)."""

DROP_LEVELS_MAX = 255
"""Whole drops of a droplet, at most (`drop_level` of the deposition models)."""


class Policy(Protocol):
    """The interface that a class needs to act in `inkloop_lab.LayerEnv`, and to control a print.

    It is made with the job, and options by keyword, as `Class(job, *, option=default)`. An attribute `drop_levels` is
    the largest number of drops that it puts on a cell (1 if it has none).
    """

    def act(self, observation: Observation) -> ArrayLike:
        """The action (nx, ny) that answers a scan, coded as `ActionCode`. No droplet ends the print."""


@dataclass(frozen=True)
class ActionCode:
    """Meaning of a cell's value in an action.

    0: no droplet; 1 + ink + inks * (level - 1): a droplet of ink 0 (A) or 1 (B) that consists of `level` drops.
    """

    shape: tuple[int, int]
    inks: int = 1
    drop_levels: int = 1

    @property
    def values(self) -> int:
        """Number of values that a cell can have."""
        return 1 + self.inks * self.drop_levels

    def check(self, action: ArrayLike) -> NDArray[Any]:
        """The action as an array. Raises ComponentError for an invalid one."""
        found = np.asarray(action)
        if found.shape != self.shape:
            raise ComponentError(f"the action has shape {found.shape}; needs {self.shape}")
        if found.dtype.kind not in "bui":
            raise ComponentError(f"the action is {found.dtype}; needs whole numbers or booleans")
        if found.min() < 0 or found.max() >= self.values:
            i, j = (int(index) for index in np.argwhere((found < 0) | (found >= self.values))[0])
            raise ComponentError(f"the action is {found[i, j]} in cell ({i}, {j}); needs 0 .. {self.values - 1}")
        return found

    def split(self, action: ArrayLike) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
        """`pattern` and `drop_level` of the layer contract. Raises ComponentError for an invalid action."""
        found = self.check(action).astype(np.int32)
        if self.values == 2:
            return found, np.ones(self.shape, np.int32)
        kind = np.maximum(found, 1) - 1
        return np.where(found > 0, 1 + kind % self.inks, 0).astype(np.int32), 1 + kind // self.inks

    def joined(self, pattern: NDArray[Any], drop_level: ArrayLike = 1) -> NDArray[np.int32]:
        """The action of a pattern and its drops per site; a droplet of no drops is none."""
        level = np.broadcast_to(drop_level, self.shape)
        action = np.where((pattern > 0) & (level > 0), pattern + self.inks * (level - 1), 0)
        return action.astype(np.int32)


def observation_of(job: Job, inputs: Values) -> dict[str, NDArray[Any]]:
    """The observation of a policy from a scan; new arrays."""
    return {
        MEASURED_HEIGHT: np.array(inputs[MEASURED_HEIGHT], np.float64),
        VALID: np.array(inputs[VALID], np.int8),
        TARGET: np.array(job.target_height, np.float64),
        MASK: np.array(job.mask, np.int8),
    }


class PolicyController:
    """Answers each scan of the layer commanded last with the action that `act` chooses, until that is no droplet.

    It acts on sequence numbers only. The memory of a policy is not saved: a resumed run begins with a new one.
    """

    def __init__(self, job: Job, act: Callable[[Observation], ArrayLike], drop_levels: int = 1) -> None:
        if not 1 <= drop_levels <= DROP_LEVELS_MAX:
            raise ValueError(f"drop_levels is {drop_levels}; needs 1 to {DROP_LEVELS_MAX}")
        shape = (job.nx, job.ny)
        self.code, self._job, self.act = ActionCode(shape, len(job.inks), drop_levels), job, act
        self.inputs = contract_ports(shape, MEASURED_HEIGHT, VALID, LAYERS_SCANNED, LAYERS_PRINTED)
        self.outputs = contract_ports(shape, PATTERN, DROP_LEVEL, LAYER_COMMAND, STATUS)
        self._answered, self._values = -1, {port.name: port.start_value() for port in self.outputs}

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        """Start again; commands count from the number of layers printed by now."""
        self._answered, self._values = -1, {port.name: port.start_value() for port in self.outputs}
        self._values[LAYER_COMMAND] = np.asarray(inputs[LAYERS_PRINTED], np.int32)
        return dict(self._values)

    def is_asked(self, inputs: Values) -> bool:
        """Whether a step with these inputs is to answer a scan."""
        scanned, command = int(inputs[LAYERS_SCANNED]), int(self._values[LAYER_COMMAND])
        is_done = int(self._values[STATUS]) == Status.DONE
        return not is_done and self._answered < scanned == command == int(inputs[LAYERS_PRINTED])

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        """Answer a new scan. Raises ComponentError for an invalid action."""
        if self.is_asked(inputs):
            pattern, level = self.code.split(self.act(observation_of(self._job, inputs)))
            self._values |= {PATTERN: pattern, DROP_LEVEL: level}
            self._answered = int(inputs[LAYERS_SCANNED])
            if pattern.any():
                self._values[LAYER_COMMAND] = np.asarray(self._answered + 1, np.int32)
            else:
                self._values[STATUS] = np.asarray(Status.DONE, np.int32)
        return dict(self._values)

    def terminate(self) -> None:
        """Nothing is held open."""

    def save(self) -> bytes:
        """The handshake and the pattern, as NumPy's npz."""
        buffer, arrays = io.BytesIO(), {"answered": np.asarray(self._answered), **self._values}
        np.savez(buffer, **arrays)  # type: ignore[arg-type]
        return buffer.getvalue()

    def restore(self, saved: bytes) -> None:
        """Continue from a saved state. Raises ComponentError if it belongs to another grid or is none."""
        try:
            with np.load(io.BytesIO(saved), allow_pickle=False) as arrays:
                found = {name: arrays[name] for name in arrays.files}
            answered, values = int(found.pop("answered")), {port.name: found[port.name] for port in self.outputs}
        except (ValueError, KeyError, OSError) as error:
            raise ComponentError(f"policy: what is to be restored is no state of its controller ({error})") from error
        if values[PATTERN].shape != self.code.shape:
            raise ComponentError(
                f"policy: the state to be restored is of a grid {values[PATTERN].shape}; needs {self.code.shape}"
            )
        self._answered, self._values = answered, values


def policy_controller(kind: str, job: Job, policy: Any) -> PolicyController:
    """The controller that goes by a policy, for the kind "env:module:Class". Raises ValueError without a method act."""
    if not callable(getattr(policy, "act", None)):
        raise ValueError(f"kind is {kind!r}, whose class has no method act(observation)")
    return PolicyController(job, policy.act, int(getattr(policy, "drop_levels", 1)))


def free_seat(job: Job, *, drop_levels: int = 1) -> PolicyController:
    """A controller whose actions come from outside, set as `act`; `inkloop_lab.LayerEnv` sits there."""

    def no_action(observation: Observation) -> ArrayLike:
        raise ComponentError("the controller's place is free; step an inkloop_lab.LayerEnv, which acts there")

    return PolicyController(job, no_action, drop_levels)


STEP_NS = 1


class ControllerPolicy:
    """Answers each observation of one print, from the first one on, with what a controller answers to that scan.

    component: a controller that acts on its inputs at once, as all of `inkloop_controller` do.
    """

    def __init__(self, component: Component, code: ActionCode) -> None:
        self._component, self._code, self._layer = component, code, 0
        self._component.initialize(0, self._inputs(-1))

    def act(self, observation: Observation) -> NDArray[np.int32]:
        """The action for the scan of the next layer; no droplet where the controller is done, or has stopped.

        Raises ComponentError, also where the controller does not answer within its step.
        """
        scan = {MEASURED_HEIGHT: observation[MEASURED_HEIGHT], VALID: observation[VALID].astype(np.bool_)}
        outputs = self._component.do_step(self._layer * STEP_NS, STEP_NS, {**self._inputs(self._layer), **scan})
        if int(outputs[STATUS]) == Status.DONE or int(outputs.get(STOP_REASON, 0)) > 0:
            return np.zeros(self._code.shape, np.int32)
        self._layer += 1
        if int(outputs[LAYER_COMMAND]) != self._layer:
            raise ComponentError(f"the controller commands layer {outputs[LAYER_COMMAND]}; needs {self._layer}")
        return self._code.joined(outputs[PATTERN], outputs.get(DROP_LEVEL, 1))

    def save(self) -> bytes:
        """The state of the controller. Raises ComponentError if it has none to save."""
        if not hasattr(self._component, "save"):
            raise ComponentError("the controller cannot save its state, which a change of its target needs")
        saved: bytes = self._component.save()
        return saved

    def restore(self, saved: bytes, layer: int) -> None:
        """Continue from a state that was saved before the scan of `layer`."""
        self._component.restore(saved)  # type: ignore[attr-defined]
        self._layer = layer

    def close(self) -> None:
        """Release the controller."""
        self._component.terminate()

    def _inputs(self, layer: int) -> dict[str, NDArray[np.generic]]:
        start = {port.name: port.start_value() for port in self._component.inputs}
        printed = np.asarray(max(layer, 0), np.int32)
        return {**start, LAYERS_SCANNED: np.asarray(layer, np.int32), LAYERS_PRINTED: printed}

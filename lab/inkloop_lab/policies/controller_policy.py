"""A controller of the layer contract as a policy of an environment: baselines to learn from and to compare with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, Status
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
)
from inkloop.errors import ComponentError
from inkloop_lab.policies.policy import ActionCode, Observation

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

"""A small action for learning: an offset of the planner's target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import Env, Wrapper
from gymnasium.spaces import Box
from numpy.typing import ArrayLike, NDArray

from inkloop.component import BoolMap
from inkloop_lab.policies import ControllerPolicy

RIM, INSIDE = 0, 1


class TargetOffset(Wrapper[Any, Any, Any, Any]):
    """An environment in which a controller plans each layer, for a target that the action shifts.

    Action (2,): offset of the target on the rim of the part and inside it, in full layers from -1 to 1; 0 leaves the
    controller as it is. The rim is the cells of the part that lack a neighbour. The controller is made for each layer,
    with the state that it was left in.

    env: a LayerEnv; kind, options: of the controller, see LayerEnv.controller.
    """

    def __init__(self, env: Env[Any, Any], kind: str | None, options: Mapping[str, Any]) -> None:
        super().__init__(env)
        self._env: Any = env
        self._kind, self._options = kind, dict(options)
        self.action_space = Box(-1.0, 1.0, (2,), np.float64)
        self._state: bytes | None = None
        self._layer, self._observation = 0, dict[str, NDArray[Any]]()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """As LayerEnv does."""
        self._observation, info = self._env.reset(seed=seed, options=options)
        self._state, self._layer = None, 0
        return self._observation, info

    def step(self, action: ArrayLike) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Print the layer that the controller plans for the shifted target. Raises ValueError for an invalid action."""
        planned = self.planned(np.asarray(action, np.float64))
        self._observation, *others = self._env.step(planned)
        self._layer += 1
        return self._observation, *others

    def planned(self, offsets: NDArray[np.float64]) -> NDArray[np.int32]:
        """The layer for these offsets (2,)."""
        if offsets.shape != (2,) or not np.abs(offsets).max() <= 1.0:
            raise ValueError(f"the offsets are {offsets}; needs two numbers from -1 to 1")
        job = self._env.job
        shift = np.where(rim(job.mask), offsets[RIM], offsets[INSIDE]) * job.inks[0].layer_height
        target = np.where(job.mask, np.maximum(job.target_height + shift, 0.0), 0.0)
        policy: ControllerPolicy = self._env.controller(self._kind, replace(job, target_height=target), **self._options)
        try:
            if self._state is not None:
                policy.restore(self._state, self._layer)
            action = policy.act(self._observation)
            self._state = policy.save()
        finally:
            policy.close()
        return action


def rim(mask: BoolMap) -> BoolMap:
    """Cells of a part (nx, ny) of whose eight neighbours one is no part of it, or off the grid."""
    nx, ny = mask.shape
    padded = np.pad(mask, 1)
    around = [padded[i : i + nx, j : j + ny] for i in range(3) for j in range(3)]
    return np.asarray(mask & ~np.logical_and.reduce(around), np.bool_)

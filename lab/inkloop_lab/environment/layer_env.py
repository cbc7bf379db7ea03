"""`inkloop_lab.LayerEnv`: a scenario whose controller's place is free, with the interface of Gymnasium."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inkloop.component import FloatMap, Job, Values
from inkloop.components import catalog
from inkloop.contract import HEIGHT, LAYERS_SCANNED, MEASURED_HEIGHT
from inkloop.course.layer_course import LayerCourse
from inkloop.errors import InkloopError, missing, require
from inkloop.master.master import Master, Turns
from inkloop.master.roles import StopReason
from inkloop.results.metrics import surface_error
from inkloop.scenario.file import Scenario
from inkloop.scenario.packaged import classes_from
from inkloop.units import NS_PER_S, UM_PER_M
from inkloop_lab.environment.freed_scenario import FreedScenario, spaces
from inkloop_lab.environment.surface_frame import frame
from inkloop_lab.policies import ActionCode, ControllerPolicy, PolicyController, observation_of

if TYPE_CHECKING:
    import gymnasium
    from gymnasium.vector import AsyncVectorEnv

    from inkloop_lab.environment.target_offset import TargetOffset

    Env = gymnasium.Env[dict[str, NDArray[Any]], ArrayLike]
elif missing("gymnasium", "LayerEnv"):
    Env = object  # the class is there without Gymnasium, and says so when it is called
else:
    from gymnasium import Env


SEEDS = 2**31


class LayerEnv(Env):
    """A scenario as an environment of Gymnasium: an action is a layer, an observation the scan of it.

    Printer, sensor, connections and events are those of the scenario; its controller is left out. With the actions of
    its controller the layers have the bits of `inkloop run`. Nothing is recorded.

    scenario: a file or a loaded Scenario; overrides: as in `inkloop.load`; alpha: weight of the objective alpha * mean
    |target - height| + (1 - alpha) * std(height) over the part (Lu et al. 2015, eq. 8); drop_levels: most drops of a
    droplet (None: as the scenario's controller); render_mode: "rgb_array" or None.

    Observation: `measured_height`, `target` [m], `valid`, `mask` (0 or 1), each (nx, ny). Action (nx, ny): 0 no
    droplet, 1 + ink + inks * (drops - 1) a droplet; no droplet at all ends the print. Reward: decrease of the objective
    of the true surface [µm]. Terminated: ended by the action, or by the status fault of a component; truncated: by
    `layers_max` or `time_max_s`. Info: `layer`, `objective` and true `height` [m], `seed`, `stop_reason` at the end.

    Needs the extra `inkloop[env]`. Raises ScenarioError; InkloopError without the extra.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 4}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | Path | str,
        overrides: Mapping[str, Any] | None = None,
        *,
        alpha: float = 0.8,
        drop_levels: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        require("gymnasium", "inkloop_lab.LayerEnv")
        if not 0.0 <= alpha <= 1.0:
            raise ValueError(f"alpha is {alpha}; needs 0 to 1")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(f"render_mode is {render_mode!r}; needs 'rgb_array' or None")
        self._freed = FreedScenario.of(scenario, overrides or {}, drop_levels)
        self._alpha, self.render_mode = alpha, render_mode
        self._scenario = self._freed.seeded(self._freed.own.tables.seed)
        job = self.job
        self._code = ActionCode((job.nx, job.ny), len(job.inks), self._freed.drop_levels)
        self.observation_space, self.action_space = spaces(self._code)
        self._turns: Turns | None = None
        self._inputs: Values = {}
        self._action: ArrayLike = np.zeros(self._code.shape, np.int32)

    @classmethod
    def vector(
        cls, scenario: Scenario | Path | str, n: int, overrides: Mapping[str, Any] | None = None, **options: Any
    ) -> AsyncVectorEnv:
        """`n` of them side by side, each in a process of its own, as one vector environment; close it at the end.

        options: keywords of LayerEnv. Raises what LayerEnv raises.
        """
        own = cls(scenario, overrides, **options)  # reports errors here, not in a process
        from functools import partial

        from gymnasium.vector import AsyncVectorEnv

        make = partial(_of_text, own._freed.own.text, own._freed.own.source, options)
        return AsyncVectorEnv([make] * n, context="spawn")

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        """Start a print and scan the start surface. seed: that of the scenario, 0 to 2^31 - 1; None: drawn.

        Raises ScenarioError, ComponentError.
        """
        super().reset(seed=seed)
        self.close()
        self._scenario = self._freed.seeded(int(self.np_random.integers(SEEDS)) if seed is None else seed)
        limits = self._scenario.tables.run
        with classes_from(self._freed.folder):
            components = self._scenario.build()
        seat = components[self._freed.name]
        assert isinstance(seat, PolicyController)
        self._seat, self._surface = seat, _Newest()
        seat.act = lambda observation: self._action  # chosen with the observation known
        self._master = Master(
            components,
            self._scenario.connections,
            step_ns=round(limits.step_s * NS_PER_S),
            algorithm=limits.algorithm,
            observers=[self._surface],
            course=LayerCourse(
                components,
                layers_max=limits.layers_max,
                events=self._scenario.events,
            ),
        )
        time_max_ns = None if limits.time_max_s is None else round(limits.time_max_s * NS_PER_S)
        self._turns = self._master.turns(time_max_ns)
        reason = self._advance()
        self._objective = self._judged()
        return observation_of(self.job, self._inputs), self._info(reason)

    def step(self, action: ArrayLike) -> tuple[dict[str, NDArray[Any]], float, bool, bool, dict[str, Any]]:
        """Print a layer and scan it. Raises ComponentError, also for an invalid action; InkloopError after the end."""
        if self._turns is None:
            raise InkloopError("the print has ended or has not begun; call reset()")
        self._code.check(action)
        self._action, before = action, self._objective
        reason = self._advance()
        self._objective = self._judged()
        reward = (before - self._objective) * UM_PER_M
        is_cut = reason in ("layers_max", "time_max")
        ended = reason is not None and not is_cut
        return observation_of(self.job, self._inputs), reward, ended, is_cut, self._info(reason)

    def render(self) -> NDArray[np.uint8] | None:
        """The surface about its mean and the last pattern side by side, as an RGB picture; None without render_mode.

        Raises InkloopError before the first reset.
        """
        if self.render_mode is None:
            return None
        if not self._inputs:
            raise InkloopError("nothing is printed yet; call reset()")
        pattern, _ = self._code.split(self._action)
        return frame(self._height(), pattern, self.job)

    def close(self) -> None:
        """End the print and release its components."""
        if self._turns is not None:
            self._turns.close()
            self._turns = None

    def controller(self, kind: str | None = None, job: Job | None = None, **options: Any) -> ControllerPolicy:
        """A controller as a policy for the print that `reset` has begun: the scenario's own, or another kind.

        job: in place of that of the print; options: of the controller. Raises ScenarioError for invalid options.
        """
        if kind is None:
            table = self._freed.own.tables.components[self._freed.name]
            kind, options = table.kind, {**table.options, **options}
        with classes_from(self._freed.folder):
            return ControllerPolicy(catalog.make(kind, job or self.job, options), self._code)

    def offset_target(self, kind: str | None = None, **options: Any) -> TargetOffset:
        """This environment with a small action: the offset of the target for which a controller plans each layer.

        kind, options: of the controller, see `controller`; it must be able to save its state.
        """
        from inkloop_lab.environment.target_offset import TargetOffset

        return TargetOffset(self, kind, options)

    @property
    def job(self) -> Job:
        """The job of the print, as its controller would receive it."""
        return self._scenario.job(self._freed.name)

    def _advance(self) -> StopReason | None:
        """Run to the next scan that waits for an action, or to the end, whose reason it returns."""
        assert self._turns is not None
        try:
            while True:
                name, self._inputs = next(self._turns)
                if name == self._freed.name and self._seat.is_asked(self._inputs):
                    return None
        except StopIteration as end:
            self._turns = None
            self._inputs = self._master.inputs(self._freed.name, self._surface.time_ns)
            reason: StopReason = end.value
            return reason
        except BaseException:
            self._turns = None
            raise

    def _height(self) -> FloatMap:
        """The true surface, or the last scan of a printer that does not report it [m]."""
        return self._surface.height if self._surface.height is not None else self._inputs[MEASURED_HEIGHT]

    def _judged(self) -> float:
        """The objective of the surface [m]."""
        error = surface_error(self._height(), self.job)
        return self._alpha * error.mae + (1.0 - self._alpha) * error.std

    def _info(self, reason: StopReason | None) -> dict[str, Any]:
        layer, seed = int(self._inputs[LAYERS_SCANNED]), self._scenario.tables.seed
        info = {"layer": layer, "objective": self._objective, "height": np.array(self._height()), "seed": seed}
        return info if reason is None else info | {"stop_reason": reason}


class _Newest:
    """Observer that keeps the time and the true surface of the last communication point."""

    def __init__(self) -> None:
        self.time_ns = 0
        self.height: FloatMap | None = None

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """The start."""
        self.stepped(time_ns, outputs)

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """The next point."""
        self.time_ns = time_ns
        self.height = next((values[HEIGHT] for values in outputs.values() if HEIGHT in values), None)


def _of_text(text: str, source: str, options: Mapping[str, Any]) -> LayerEnv:
    """An environment in another process."""
    with classes_from(Path(source).parent):
        return LayerEnv(Scenario.of_text(text, source), **options)

"""Options of an environment: weights, options of controllers, allowed components, pictures."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import inkloop
import inkloop_lab
from inkloop_lab.environment import layer_env
from inkloop_lab.environment.freed_scenario import FreedScenario
from inkloop_lab.policies.policy import ActionCode
from support.places import SCENARIOS

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'inkloop[env]'")
CUBOID = SCENARIOS / "cuboid.toml"
NOISY = {"components.profiler": {"noise_std_um": 3.0}}


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_objective_weighs_mean_error_and_unevenness_of_the_true_surface(alpha: float) -> None:
    env = inkloop_lab.LayerEnv(CUBOID, NOISY, alpha=alpha)
    observation, info = env.reset(seed=3)
    objectives = [info["objective"]]
    for _ in range(2):
        observation, reward, _, _, info = env.step(observation["mask"])
        objectives.append(info["objective"])
        assert reward == pytest.approx(1e6 * (objectives[-2] - objectives[-1]), rel=1e-12, abs=0.0)
        error = (env.job.target_height - info["height"])[env.job.mask]
        expected = alpha * np.abs(error).mean() + (1.0 - alpha) * error.std()
        assert info["objective"] == pytest.approx(expected, rel=1e-9, abs=0.0)
        assert np.abs(observation["measured_height"] - info["height"]).max() > 1e-6
        info["height"][:] = 1.0  # the caller's own
    env.close()


def test_environments_side_by_side_have_the_options_that_were_given(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Any] = []

    def side_by_side(makes: Any, context: str) -> str:
        made[:] = [make() for make in makes]
        return context

    monkeypatch.setattr("gymnasium.vector.AsyncVectorEnv", side_by_side)
    assert inkloop_lab.LayerEnv.vector(CUBOID, 3, {"run.layers_max": 2}, alpha=0.1, render_mode="rgb_array") == "spawn"
    assert [(env._alpha, env.render_mode, env._scenario.tables.run.layers_max) for env in made] == [
        (0.1, "rgb_array", 2)
    ] * 3


def test_controller_has_the_job_and_options_that_were_given(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr("inkloop.components.catalog.make", lambda *given: asked.append(given))
    monkeypatch.setattr(layer_env, "ControllerPolicy", lambda made, code: None)
    env = inkloop_lab.LayerEnv(CUBOID, {"components.controller.horizon": 3})
    other = inkloop_lab.LayerEnv(SCENARIOS / "two-materials.toml").job
    env.controller()
    env.controller(horizon=1)
    env.controller("ErrorDiffusion", other, seed=2)
    (own, own_job, first), (_, _, changed), last = asked
    assert (own, own_job.nx, first["horizon"]) == ("LayerMpc", 12, 3)
    assert changed == {**first, "horizon": 1}
    assert last == ("ErrorDiffusion", other, {"seed": 2})


def test_picture_is_of_the_true_surface_and_of_the_last_pattern(monkeypatch: pytest.MonkeyPatch) -> None:
    env = inkloop_lab.LayerEnv(CUBOID, NOISY, render_mode="rgb_array")
    with pytest.raises(inkloop.InkloopError, match=r"nothing is printed yet; call reset\(\)"):
        env.render()
    observation, _ = env.reset(seed=1)
    _, _, _, _, info = env.step(observation["mask"])
    monkeypatch.setattr(layer_env, "frame", lambda height, pattern, job: (height, pattern, job.nx))
    height, pattern, nx = env.render()  # type: ignore[misc]
    np.testing.assert_array_equal(height, info["height"])
    np.testing.assert_array_equal(pattern, observation["mask"])
    assert nx == 12
    env.close()
    plain = inkloop_lab.LayerEnv(CUBOID)
    assert plain.render() is None  # before the first reset too: nobody asked for pictures


def test_place_of_the_controller_has_its_drop_levels_or_those_that_were_given() -> None:
    grey = SCENARIOS / "grey-head.toml"
    of_controller = FreedScenario.of(grey, {}, None)
    assert of_controller.drop_levels == of_controller.own.tables.components["controller"].options["drop_levels"] > 1
    assert FreedScenario.of(grey, {}, 1).drop_levels == 1
    assert FreedScenario.of(CUBOID, {}, None).drop_levels == 1
    assert FreedScenario.of(CUBOID, {}, 5).seeded(4).tables.components["controller"].options == {"drop_levels": 5}
    code = inkloop_lab.LayerEnv(CUBOID, drop_levels=5)._code
    assert code == ActionCode((12, 12), 1, 5)

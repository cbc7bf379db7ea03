"""The environment: a scenario with the controller's place free, whose layers keep their bits."""

from __future__ import annotations

import subprocess
import sys
import warnings
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import inkloop
import inkloop_lab
from inkloop.component import Ink, Job
from inkloop.printing.run import print_part
from inkloop_lab.environment import layer_env
from inkloop_lab.environment.freed_scenario import FreedScenario
from inkloop_lab.environment.surface_frame import frame
from inkloop_lab.policies import ActionCode
from support.places import SCENARIOS
from support.prints import LITTLE_WORK

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'inkloop[env]'")
CUBOID = SCENARIOS / "cuboid.toml"
EVENTS = [
    {"at_layer": 2, "action": "bias", "port": "profiler.measured_height", "value_um": 0.7},
    {"at_time_s": 9.0, "action": "override", "port": "printer.pattern", "value": 0, "nozzles": [5]},
    {"at_time_s": 14.0, "action": "bias", "port": "controller.measured_height", "value_um": -0.4},
]
NOISY = {
    "components.printer.nozzle_pitch": 12,
    "components.profiler": {"noise_std_um": 0.8, "dropout_rate": 0.1, "scan_duration_s": 2.0},
}
QUICK = {"components.controller.horizon": 1, "components.controller.annealing_sweeps": 0, "run.layers_max": 8}
CASES: Mapping[str, tuple[str, Mapping[str, Any]]] = {
    "planned ahead": ("cuboid", {**dict(LITTLE_WORK), "run.layers_max": 2}),
    "noise, drop-outs, events by layer and time": ("cuboid", {**NOISY, **QUICK, "events": EVENTS}),
    "Jacobi steps": ("cuboid", {**NOISY, **QUICK, "events": EVENTS, "run.algorithm": "jacobi"}),
    "two inks": ("two-materials", {**QUICK, "run.layers_max": 4}),
    "several drops": ("grey-head", {**QUICK, "run.layers_max": 4}),
    "drifting ink": ("drifting-ink", {**QUICK, "run.layers_max": 12}),
}
BASELINES = ("OpenLoop", "ErrorDiffusion", "StochasticGreedy")


def played(env: inkloop_lab.LayerEnv, policy: Any, seed: int) -> tuple[list[Any], float, dict[str, Any]]:
    """The surfaces after each layer, the sum of rewards, and the last info."""
    observation, info = env.reset(seed=seed)
    acting = policy(env)
    surfaces, total, ended = [info["height"]], 0.0, False
    while not ended:
        observation, reward, terminated, truncated, info = env.step(acting.act(observation))
        total, ended = total + reward, terminated or truncated
        if info["layer"] == len(surfaces):
            surfaces.append(info["height"])
    return surfaces, total, info


@pytest.mark.parametrize("case", CASES)
def test_controller_of_the_scenario_prints_the_bits_of_a_run(case: str) -> None:
    name, overrides = CASES[case]
    scenario = inkloop.load(SCENARIOS / f"{name}.toml", {**overrides, "seed": 5})
    assert isinstance(scenario, inkloop.Scenario)
    run = print_part(scenario)
    surfaces, _, info = played(inkloop_lab.LayerEnv(scenario), lambda env: env.controller(), 5)
    np.testing.assert_array_equal(surfaces, run.dataset["height"].values)
    assert info["stop_reason"] == run.stop_reason


@pytest.mark.parametrize("kind", BASELINES)
def test_baseline_prints_the_bits_of_a_run(kind: str) -> None:
    text = CUBOID.read_text(encoding="utf-8").replace('kind = "LayerMpc"\nalpha = 0.8', f'kind = "{kind}"')
    run = print_part(inkloop.Scenario.of_text(text, str(CUBOID), {**NOISY, "seed": 7}))
    surfaces, total, _ = played(inkloop_lab.LayerEnv(CUBOID, NOISY), lambda env: env.controller(kind), 7)
    np.testing.assert_array_equal(surfaces, run.dataset["height"].values)
    errors = [run.dataset[name].values for name in ("mae", "std")]
    objective = 0.8 * errors[0] + 0.2 * errors[1]
    assert total == pytest.approx(1e6 * (objective[0] - objective[-1]), rel=1e-9, abs=0.0)


@pytest.mark.system
@pytest.mark.parametrize("name", ["cuboid", "two-materials"])
def test_checker_of_gymnasium_finds_nothing(name: str) -> None:
    from gymnasium.utils.env_checker import check_env

    spec = gymnasium.envs.registration.EnvSpec("Checked-v0", "inkloop_lab.environment.layer_env:LayerEnv")
    options = {"scenario": str(SCENARIOS / f"{name}.toml"), "render_mode": "rgb_array"}
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        with gymnasium.make(spec, disable_env_checker=True, **options) as env:
            check_env(env.unwrapped)


def test_offset_of_nothing_is_the_controller_itself() -> None:
    """The learnt ink is kept from layer to layer, though each one is planned anew."""
    overrides = {**NOISY, **QUICK}
    plain, _, _ = played(inkloop_lab.LayerEnv(CUBOID, overrides), lambda env: env.controller(), 3)
    env = inkloop_lab.LayerEnv(CUBOID, overrides).offset_target()

    class Steady:
        def act(self, observation: object) -> Any:
            return np.zeros(2)

    surfaces, _, _ = played(env, lambda env: Steady(), 3)  # type: ignore[arg-type]
    np.testing.assert_array_equal(surfaces, plain)


def test_time_that_runs_out_cuts_the_print_off() -> None:
    env = inkloop_lab.LayerEnv(CUBOID, {"run.time_max_s": 2.0})
    observation, _ = env.reset(seed=1)
    _, _, terminated, truncated, info = env.step(observation["mask"])
    assert (terminated, truncated, info["stop_reason"]) == (False, True, "time_max")


@pytest.mark.parametrize(
    ("name", "kind", "values"), [("cuboid", "MultiBinary", 2), ("two-materials", "MultiDiscrete", 3)]
)
def test_spaces_hold_what_is_observed_and_done(name: str, kind: str, values: int) -> None:
    env = inkloop_lab.LayerEnv(SCENARIOS / f"{name}.toml")
    shape = (env.job.nx, env.job.ny)
    space = env.observation_space
    assert type(env.action_space).__name__ == kind
    assert env.action_space.shape == shape
    assert env.action_space.contains(np.full(shape, values - 1, env.action_space.dtype))
    assert not env.action_space.contains(np.full(shape, values, env.action_space.dtype))
    assert set(space) == {"measured_height", "valid", "target", "mask"}  # type: ignore[call-overload]
    marks = {each: np.ones(shape, np.int8) for each in ("valid", "mask")}
    heights = {each: np.full(shape, -1.0) for each in ("measured_height", "target")}
    assert space.contains({**heights, **marks})
    for wrong in ({"valid": 2 * marks["valid"]}, {"target": 1.01 * heights["target"]}, {"mask": marks["mask"][1:]}):
        assert not space.contains({**heights, **marks, **wrong})


def test_end_is_told_and_needs_a_reset() -> None:
    env = inkloop_lab.LayerEnv(CUBOID, {"run.layers_max": 1}, render_mode="rgb_array")
    with pytest.raises(inkloop.InkloopError, match=r"call reset\(\)"):
        env.step(np.zeros((12, 12), np.int8))
    observation, info = env.reset(seed=1)
    assert env.observation_space.contains(observation)
    _, reward, terminated, truncated, info = env.step(observation["mask"])
    assert (terminated, truncated, info["stop_reason"], info["layer"]) == (False, True, "layers_max", 1)
    assert reward > 5.0
    with pytest.raises(inkloop.InkloopError, match=r"the print has ended or has not begun; call reset\(\)"):
        env.step(observation["mask"])
    observation, _ = env.reset(seed=1)
    same, reward, terminated, truncated, info = env.step(np.zeros((12, 12), np.int8))
    assert (terminated, truncated, info["stop_reason"], reward) == (True, False, "done", 0.0)
    np.testing.assert_array_equal(same["measured_height"], observation["measured_height"])


def test_invalid_action_changes_nothing() -> None:
    env = inkloop_lab.LayerEnv(CUBOID)
    observation, _ = env.reset(seed=1)
    action = np.zeros((12, 12), np.int32)
    action[3, 4] = 2
    with pytest.raises(inkloop.ComponentError, match=r"the action is 2 in cell \(3, 4\); needs 0 .. 1"):
        env.step(action)
    _, _, _, _, info = env.step(observation["mask"])
    assert info["layer"] == 1
    env.close()


def test_overrides_are_laid_over_a_scenario_that_was_loaded() -> None:
    scenario = inkloop.load(CUBOID, {"run.layers_max": 7})
    assert isinstance(scenario, inkloop.Scenario)
    found = FreedScenario.of(scenario, {"seed": 9, "grid.pitch_um": 250.0}, None).own.tables
    assert (found.run.layers_max, found.seed, found.grid.pitch_um) == (7, 9, 250.0)
    assert FreedScenario.of(scenario, {}, None).own is scenario
    freed = FreedScenario.of(scenario, {"metrology.parameters": ["Sz"]}, None)
    assert freed.own.tables.metrology is not None
    tables = freed.seeded(3).tables
    assert (tables.metrology, tables.compare, tables.literature) == (None, {}, {})  # none of which a layer needs


def test_print_that_has_failed_and_one_before_a_reset_have_ended() -> None:
    env = inkloop_lab.LayerEnv(CUBOID)
    observation, _ = env.reset(seed=1)

    def fails(_: object) -> Any:
        raise inkloop.ComponentError("broken")

    env._seat.act = fails
    with pytest.raises(inkloop.ComponentError, match="broken"):
        env.step(observation["mask"])
    with pytest.raises(inkloop.InkloopError, match=r"the print has ended or has not begun; call reset\(\)"):
        env.step(observation["mask"])
    env.reset(seed=1)
    before = env._turns
    assert before is not None
    env.reset(seed=2)
    assert next(before, None) is None
    env.close()


def test_print_of_a_printer_that_does_not_know_its_surface_is_judged_by_the_last_scan() -> None:
    env = inkloop_lab.LayerEnv(CUBOID, NOISY)
    observation, info = env.reset(seed=1)
    assert not np.array_equal(info["height"], observation["measured_height"])
    env._surface.height = None
    np.testing.assert_array_equal(env._height(), observation["measured_height"])
    env.close()


def test_seeds_are_those_of_the_scenario_and_drawn_without_one() -> None:
    env = inkloop_lab.LayerEnv(CUBOID)
    _, first = env.reset(seed=4)
    _, second = env.reset()
    _, third = env.reset()
    assert first["seed"] == 4
    assert len({first["seed"], second["seed"], third["seed"]}) == 3
    assert max(second["seed"], third["seed"]) > 2**24  # of all seeds that a scenario may have
    env.reset(seed=4)
    assert env.reset()[1]["seed"] == second["seed"]
    with pytest.raises(inkloop.ScenarioError, match="seed"):
        env.reset(seed=2**31)


@pytest.mark.long
def test_environments_side_by_side_print_what_one_prints() -> None:
    pattern = np.zeros((12, 12), np.int8)
    pattern[2:-2, 2:-2] = 1
    vector = inkloop_lab.LayerEnv.vector(CUBOID, 2, NOISY)
    try:
        vector.reset(seed=11)
        for _ in range(3):
            observations, rewards, *_ = vector.step(np.stack([pattern, pattern]))
    finally:
        vector.close()
    for k in range(2):
        env = inkloop_lab.LayerEnv(CUBOID, NOISY)
        env.reset(seed=11 + k)
        for _ in range(3):
            observation, reward, *_ = env.step(pattern)
        assert rewards[k] == reward
        np.testing.assert_array_equal(observations["measured_height"][k], observation["measured_height"])
        env.close()


def test_devices_and_impossible_options_are_refused() -> None:
    with pytest.raises(inkloop.ScenarioError, match=r"is 'hardware\.printer', no model; LayerEnv needs"):
        inkloop_lab.LayerEnv(SCENARIOS / "bench.toml")
    text = (SCENARIOS / "bench.toml").read_text(encoding="utf-8").partition("[components.profiler]")[0]
    text += '[components.profiler]\nkind = "MapFolder"\nfolder = "maps"\n'
    with pytest.raises(inkloop.ScenarioError, match=r"components\.profiler\.kind is 'MapFolder', no model; LayerEnv"):
        inkloop_lab.LayerEnv(inkloop.Scenario.of_text(text, str(SCENARIOS / "bench.toml")))
    with pytest.raises(ValueError, match="alpha is 2"):
        inkloop_lab.LayerEnv(CUBOID, alpha=2.0)
    with pytest.raises(ValueError, match="render_mode is 'human'; needs 'rgb_array' or None"):
        inkloop_lab.LayerEnv(CUBOID, render_mode="human")


def test_missing_extra_is_named() -> None:
    """The name is there all the same, so that `from inkloop_lab import *` works without the extra."""
    code = (
        "import sys; sys.modules['gymnasium'] = None\nimport inkloop, inkloop_lab\n"
        "try:\n    inkloop_lab.LayerEnv('case.toml')\nexcept inkloop.InkloopError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "inkloop_lab.LayerEnv needs the package gymnasium: pip install 'inkloop[env]'"


VERY_NOISY = {"components.profiler": {"noise_std_um": 3.0}}


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_objective_weighs_mean_error_and_unevenness_of_the_true_surface(alpha: float) -> None:
    env = inkloop_lab.LayerEnv(CUBOID, VERY_NOISY, alpha=alpha)
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
    env = inkloop_lab.LayerEnv(CUBOID, VERY_NOISY, render_mode="rgb_array")
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


MASK = np.zeros((8, 4), np.bool_)
MASK[1:6, 1:3] = True


def job(inks: int = 1) -> Job:
    return Job(8, 4, 1e-4, np.where(MASK, 20e-6, 0.0), MASK, (Ink(), Ink(9e-6, 0.0, 0.0))[:inks])


def panels(height: Any, pattern: Any, inks: int = 1) -> tuple[Any, Any]:
    """The colours of each cell (nx, ny, 3), of the surface and of the pattern."""
    image = frame(height, pattern, job(inks))
    assert image.dtype == np.uint8
    assert image.shape == (4 * 32, 17 * 32, 3)  # 256 pixels for the longer side, a cell as wide as high
    cells = image[16::32, 16::32][::-1].transpose(1, 0, 2)
    assert (cells[8] == 255).all()
    return cells[:8], cells[9:]


def test_high_cells_are_red_and_low_ones_blue_about_the_mean() -> None:
    height = job().target_height + 3e-6 * MASK  # all of it too high: nothing is uneven
    height[2, 1] += 9 * 7.6e-6 / 9
    height[4, 2] -= 9 * 7.6e-6 / 9
    surface, _ = panels(height, np.zeros((8, 4), np.int32))
    np.testing.assert_array_equal(
        panels(height, np.zeros((8, 4), np.int32), 2)[0], surface
    )  # layers are of the first ink
    assert tuple(surface[3, 1]) == (247, 247, 247)
    half = {(2, 1): (178, 24, 43), (4, 2): (33, 102, 172)}  # one layer of the two that the colours span
    for cell, end in half.items():
        np.testing.assert_allclose(surface[cell].astype(float), (247 + np.array(end)) / 2, atol=0.51)
    assert {tuple(colour) for colour in surface[~MASK]} == {(230, 230, 230)}
    height[2, 1] += 1.0
    clipped, _ = panels(height, np.zeros((8, 4), np.int32))
    assert tuple(clipped[2, 1]) == (178, 24, 43)


@pytest.mark.parametrize("inks", [1, 2])
def test_droplets_have_the_colour_of_their_ink(inks: int) -> None:
    pattern = np.zeros((8, 4), np.int32)
    pattern[2, 1], pattern[5, 2] = 1, inks
    _, droplets = panels(job().target_height, pattern, inks)
    assert tuple(droplets[2, 1]) == (40, 40, 40)
    assert tuple(droplets[5, 2]) == ((40, 40, 40) if inks == 1 else (200, 120, 20))
    assert tuple(droplets[3, 1]) == (247, 247, 247)
    assert tuple(droplets[0, 0]) == (230, 230, 230)

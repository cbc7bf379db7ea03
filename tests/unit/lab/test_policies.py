"""Policies as controllers: what their actions mean, and the handshake around them."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import inkloop
from inkloop.component import Ink, Job, Values
from inkloop.components import catalog
from inkloop.errors import ComponentError
from inkloop.testing import RESUMABLE_CONTRACT_CHECKS
from inkloop.testing import job as job_of_checks
from inkloop_lab.policies import ActionCode, PolicyController, observation_of, policy_controller
from support.places import SCENARIOS
from support.toys import toy_job

POLICY = (
    "import numpy as np\n\n\nclass Fill:\n    def __init__(self, job, *, share: float = 0.5):\n"
    "        self.least = share * job.inks[0].layer_height\n\n    def act(self, observation):\n"
    "        lacking = observation['target'] - observation['measured_height']\n"
    "        return (lacking > self.least) & (observation['mask'] > 0)\n\n\nclass Rule(Fill):\n    act = None\n"
    "    def pattern(self, height, layer):\n        return (0 * height).astype(int)\n"
)


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "own_policies.py").write_text(POLICY, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    return "own_policies"


@pytest.mark.parametrize(("inks", "levels"), [(1, 1), (2, 1), (1, 4), (2, 3)])
def test_every_action_is_one_droplet_and_back(inks: int, levels: int) -> None:
    code = ActionCode((1, 1 + inks * levels), inks, levels)
    action = np.arange(code.values)[None]
    pattern, level = code.split(action)
    np.testing.assert_array_equal(code.joined(pattern, level), action)
    assert {(int(p), int(n)) for p, n in zip(pattern[0], level[0], strict=True) if p} == {
        (ink, drops) for ink in range(1, inks + 1) for drops in range(1, levels + 1)
    }
    assert (pattern[0, 0], level[0, 0]) == (0, 1)
    assert code.joined(np.ones(code.shape, np.int32), np.zeros(code.shape, np.int32)).max() == 0


def test_second_ink_and_second_drop_have_the_values_of_the_page() -> None:
    code = ActionCode((1, 3), inks=2, drop_levels=2)
    pattern, level = code.split(np.array([[2, 3, 4]]))
    assert pattern.tolist() == [[2, 1, 2]]
    assert level.tolist() == [[1, 2, 2]]


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_policy_in_the_place_of_a_controller_keeps(check, module: str) -> None:
    check(lambda: catalog.make(f"env:{module}:Fill", job_of_checks(), {"share": 0.3}))


def test_policy_controls_a_print(module: str) -> None:
    text = (SCENARIOS / "cuboid.toml").read_text(encoding="utf-8").partition("[compare.")[0]
    own = text.replace('kind = "LayerMpc"\nalpha = 0.8', f'kind = "env:{module}:Fill"\nshare = 0.4')
    result = inkloop.run(inkloop.Scenario.of_text(own, "case.toml"))
    assert result.metrics()["mae"] < 3e-6
    assert result.stop_reason == "done"


def test_class_that_is_no_policy_is_named(module: str) -> None:
    job = Job(4, 4, 1e-4, np.full((4, 4), 1e-3), np.ones((4, 4), np.bool_), (Ink(),))
    [error] = catalog.check(f"env:{module}:Rule", job, {}).errors
    assert error == f"kind is 'env:{module}:Rule', whose class has no method act(observation)"
    assert not catalog.check(f"{module}:Rule", job, {}).errors
    [error] = catalog.check(f"{module}:Fill", job, {}).errors
    assert error.endswith(f"needs those, or a method pattern, or an adapter: env:{module}:Fill")
    [error] = catalog.check(f"enw:{module}:Fill", job, {}).errors
    assert error.startswith(f"kind is 'enw:{module}:Fill'; ")
    for levels in (0, 256):
        with pytest.raises(ValueError, match=f"drop_levels is {levels}; needs 1 to 255"):
            PolicyController(job, np.zeros_like, levels)
    PolicyController(job, np.zeros_like, 255)


def test_policy_puts_down_as_many_drops_as_its_class_says() -> None:
    job = Job(4, 4, 1e-4, np.full((4, 4), 1e-3), np.ones((4, 4), np.bool_), (Ink(),))
    policies = (SimpleNamespace(act=np.zeros_like), SimpleNamespace(act=np.zeros_like, drop_levels=3))
    assert [policy_controller("env:a:B", job, policy).code.drop_levels for policy in policies] == [1, 3]


def test_state_of_another_grid_is_refused() -> None:
    jobs = [Job(n, n, 1e-4, np.full((n, n), 1e-3), np.ones((n, n), np.bool_), (Ink(),)) for n in (3, 4)]
    first, second = (PolicyController(job, np.zeros_like) for job in jobs)
    with pytest.raises(inkloop.ComponentError, match=r"is of a grid \(3, 3\); needs \(4, 4\)"):
        second.restore(first.save())
    with pytest.raises(inkloop.ComponentError, match="is no state of its controller"):
        second.restore(b"rubbish")
    assert first.code.values == ActionCode((3, 3)).values == 2  # a droplet or none


def test_observation_is_of_new_arrays_in_the_types_of_the_page() -> None:
    """A policy may keep them, and alter them, whatever the scan that follows is written into."""
    job = toy_job(nx=4, ny=3)
    valid = np.arange(12).reshape(4, 3) % 2 > 0
    scan: Values = {"measured_height": np.arange(12.0).reshape(4, 3), "valid": valid}
    found = observation_of(job, scan)
    expected = {
        "measured_height": scan["measured_height"].copy(), "valid": valid.astype(np.int8),
        "target": job.target_height.copy(), "mask": job.mask.astype(np.int8),
    }  # fmt: skip
    assert {name: str(values.dtype) for name, values in found.items()} == {
        "measured_height": "float64", "valid": "int8", "target": "float64", "mask": "int8",
    }  # fmt: skip
    scan["measured_height"][...], scan["valid"][...] = -1.0, False
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values)
    found["target"][...] = found["mask"][...] = 0
    np.testing.assert_array_equal(job.target_height, expected["target"])
    np.testing.assert_array_equal(job.mask, expected["mask"])


def test_policy_is_asked_once_for_each_scan_until_it_is_done() -> None:
    job = Job(3, 3, 1e-4, np.full((3, 3), 1e-3), np.ones((3, 3), np.bool_), (Ink(),))
    answers = iter([np.eye(3, dtype=int), np.eye(3, dtype=int), np.zeros((3, 3), int)])
    controller = PolicyController(job, lambda observation: next(answers))

    def step(scanned: int, printed: int) -> tuple[int, int]:
        counts = {"layers_scanned": scanned, "layers_printed": printed}
        maps = {"measured_height": np.zeros((3, 3)), "valid": np.ones((3, 3), np.bool_)}
        found = controller.do_step(0, 1, {**maps, **{name: np.asarray(count) for name, count in counts.items()}})
        return int(found["layer_command"]), int(found["status"])

    controller.initialize(0, {"layers_printed": np.asarray(4)})
    steps = [(-1, 4), (4, 4), (4, 4), (4, 5), (5, 5), (6, 6), (6, 6)]
    assert [step(*each)[0] for each in steps] == [4, 5, 5, 5, 6, 6, 6]
    assert step(6, 6)[1] == inkloop.Status.DONE
    assert next(answers, None) is None


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([[0, 1, 5]], r"the action is 5 in cell \(0, 2\); needs 0 .. 4"),
        ([[0, -1, 5]], r"the action is -1 in cell \(0, 1\); needs 0 .. 4"),
        ([[0.0, 1.0, 2.0]], "the action is float64; needs whole numbers or booleans"),
        ([0, 1, 2], r"the action has shape \(3,\); needs \(1, 3\)"),
    ],
)
def test_action_that_is_none_is_named(action: list[Any], message: str) -> None:
    code = ActionCode((1, 3), inks=2, drop_levels=2)
    with pytest.raises(ComponentError, match=message):
        code.split(np.array(action))
    for kind in (np.int8, np.uint8, np.int64):
        assert code.split(np.array([[0, 4, 1]], kind))[1].tolist() == [[1, 2, 1]]
    assert ActionCode((1, 2)).split(np.array([[True, False]]))[0].tolist() == [[1, 0]]

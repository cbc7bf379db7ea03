"""The target that a controller plans for: shifted on the rim and inside as the action says; the print is a double."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job, Status
from inkloop.errors import ComponentError
from inkloop_lab.policies import ActionCode
from support.toys import FunctionComponent

gymnasium = pytest.importorskip("gymnasium", reason="needs gymnasium: pip install 'inkloop[env]'")

from inkloop_lab.environment.target_offset import TargetOffset, rim  # noqa: E402
from inkloop_lab.policies import ControllerPolicy  # noqa: E402

MASK = np.zeros((7, 6), np.bool_)
MASK[1:6, 0:5] = True
"""At the edge of the grid along y."""
INSIDE = np.zeros_like(MASK)
INSIDE[2:5, 1:4] = True
INK = Ink(4.4e-6, 0.6e-6, 0.2e-6)
TARGET = np.where(MASK, 20e-6, 0.0)
TARGET[3, 2] = 3e-6


class Policy:
    """Answers with what it was asked; its state is the number of its layers."""

    def __init__(self, log: list[Any], job: Job) -> None:
        self._log, self._job, self._state = log, job, b"0"

    def restore(self, state: bytes, layer: int) -> None:
        self._log.append(("restore", state, layer))
        self._state = state

    def act(self, observation: Any) -> Any:
        self._log.append(("target", self._job.target_height, observation))
        self._state = str(int(self._state) + 1).encode()
        return observation

    def save(self) -> bytes:
        return self._state

    def close(self) -> None:
        self._log.append("close")


class Env(gymnasium.Env):  # type: ignore[name-defined]
    """Prints nothing; `log` has what was asked of it and of its controllers."""

    def __init__(self) -> None:
        self.job, self.log = Job(7, 6, 1e-4, TARGET, MASK, (INK, Ink(9e-6, 0.0, 0.0))), list[Any]()

    def controller(self, kind: str, job: Job, **options: Any) -> Policy:
        self.log.append((kind, options))
        return Policy(self.log, job)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        return f"seed {seed}", {}

    def step(self, action: Any) -> Any:
        return f"after {action}", 1.0, False, False, {}


def test_rim_lacks_a_neighbour_in_the_part_or_on_the_grid() -> None:
    np.testing.assert_array_equal(rim(MASK), MASK & ~INSIDE)
    hole = MASK.copy()
    hole[3, 2] = False
    np.testing.assert_array_equal(rim(hole), hole)


def test_target_is_shifted_by_full_layers_of_the_first_ink_and_never_below_the_substrate() -> None:
    env = Env()
    offset = TargetOffset(env, "LayerMpc", {"horizon": 2})
    offset.reset(seed=4)
    offset.step([0.5, -1.0])
    layer = 4.4e-6 + 4 * 0.6e-6 + 4 * 0.2e-6
    expected = np.where(INSIDE, 20e-6 - layer, np.where(MASK, 20e-6 + 0.5 * layer, 0.0))
    expected[3, 2] = 0.0
    kind, (_, target, observation), closed = env.log
    assert kind == ("LayerMpc", {"horizon": 2})
    np.testing.assert_allclose(target, expected, rtol=1e-12, atol=0.0)
    assert (observation, closed) == ("seed 4", "close")


def test_controller_continues_from_its_state_and_begins_again_with_each_print() -> None:
    env = Env()
    offset = TargetOffset(env, None, {})
    for _ in range(2):
        offset.reset(seed=1)
        for _ in range(3):
            offset.step(np.zeros(2))
    restored = [entry[1:] for entry in env.log if entry[0] == "restore"]
    assert restored == [(b"1", 1), (b"2", 2)] * 2
    seen = [entry[2] for entry in env.log if entry[0] == "target"]
    assert seen[:3] == ["seed 1", "after seed 1", "after after seed 1"]
    assert env.log.count("close") == 6


@pytest.mark.parametrize("offsets", [[1.001, 0.0], [0.0, -1.001], [np.nan, 0.0], [0.0], [[0.0, 0.0]]])
def test_offsets_beyond_a_layer_are_refused(offsets: Any) -> None:
    env = Env()
    offset = TargetOffset(env, None, {})
    offset.reset()
    with pytest.raises(ValueError, match="needs two numbers from -1 to 1"):
        offset.step(offsets)
    assert env.log == []
    offset.step([1.0, -1.0])


def commanding(*commands: int, status: int = Status.IDLE, stop_reason: int = 0) -> tuple[FunctionComponent, list[Any]]:
    """A controller that commands these layers; and what it is asked."""
    answers, asked = iter(commands), list[Any]()

    def step(time_ns: int, step_ns: int, inputs: Any) -> Any:
        asked.append((int(inputs["layers_scanned"]), int(inputs["layers_printed"]), inputs["valid"].dtype))
        pattern = np.where(MASK, 1, 0).astype(np.int32)
        state = {"status": np.asarray(status), "stop_reason": np.asarray(stop_reason)}
        return {**state, "layer_command": np.asarray(next(answers)), "pattern": pattern}

    def start(inputs: Any) -> Any:
        asked.append((int(inputs["layers_scanned"]), int(inputs["layers_printed"])))
        return {}

    return FunctionComponent(step=step, start=start), asked


SCAN: Any = {"measured_height": np.zeros(MASK.shape), "valid": np.ones(MASK.shape, np.int8)}


def test_controller_is_given_each_scan_with_its_number() -> None:
    controller, asked = commanding(1, 2, 4)
    policy = ControllerPolicy(controller, ActionCode((7, 6)))
    for _ in range(2):
        np.testing.assert_array_equal(policy.act(SCAN), MASK)
    assert asked == [(-1, 0), (0, 0, np.bool_), (1, 1, np.bool_)]
    with pytest.raises(ComponentError, match="the controller commands layer 4; needs 3"):
        policy.act(SCAN)
    with pytest.raises(ComponentError, match="the controller cannot save its state"):
        policy.save()
    policy.close()
    assert controller.log[-1] == "terminate"


def test_drops_of_a_controller_are_in_the_action() -> None:
    level = np.where(INSIDE, 2, 1)

    def step(time_ns: int, step_ns: int, inputs: Any) -> Any:
        counts = {"status": np.asarray(Status.IDLE), "layer_command": np.asarray(1)}
        return {**counts, "pattern": MASK.astype(np.int32), "drop_level": level}

    policy = ControllerPolicy(FunctionComponent(step=step), ActionCode((7, 6), inks=2, drop_levels=2))
    np.testing.assert_array_equal(policy.act(SCAN), np.where(INSIDE, 3, MASK))


def test_controller_that_is_done_or_does_not_answer() -> None:
    done, _ = commanding(0, status=Status.DONE)
    assert not ControllerPolicy(done, ActionCode((7, 6))).act(SCAN).any()
    stopped, _ = commanding(0, status=Status.UNTRUSTED, stop_reason=64)
    assert not ControllerPolicy(stopped, ActionCode((7, 6))).act(SCAN).any()
    silent, _ = commanding(0)
    with pytest.raises(ComponentError, match="the controller commands layer 0; needs 1"):
        ControllerPolicy(silent, ActionCode((7, 6))).act(SCAN)

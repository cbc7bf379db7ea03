"""The handshake of the controller."""

from __future__ import annotations

import io
import re
import weakref
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Ink, Status
from inkloop.errors import ComponentError
from inkloop_controller.baseline_planners import OpenLoop
from inkloop_controller.controllers import LayerMpcController, OpenLoopController, StochasticGreedyController
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model import LayerModel
from inkloop_controller.planning.layer_plan import LayerPlan, LeftOut, PlanStatus
from inkloop_controller.problem.horizon_problem import IntPlan, Objective
from support.closed_loop import SECOND, block, inputs_of, print_part
from support.half_spaces import Below

MAKERS = [LayerMpcController, OpenLoopController, StochasticGreedyController]
JOB = block()
FLAT = np.zeros((JOB.nx, JOB.ny))


def started(controller: Component, layer: int = 0) -> Component:
    controller.initialize(0, inputs_of(JOB, FLAT, layer))
    return controller


def answer(controller: Component, height: Any, scanned: int, printed: int, valid: Any = None) -> dict[str, Any]:
    inputs = inputs_of(JOB, height, printed, valid) | {"layers_scanned": np.asarray(scanned, np.int32)}
    return dict(controller.do_step(0, SECOND, inputs))


@pytest.mark.parametrize("make", MAKERS)
def test_layer_is_commanded_once_the_last_one_is_printed_and_scanned(make: Any) -> None:
    controller = started(make(JOB))
    assert answer(controller, FLAT, -1, 0)["layer_command"] == 0  # no scan yet
    assert answer(controller, FLAT, 0, 0)["layer_command"] == 1
    for scanned, printed in ((0, 0), (0, 1), (1, 0)):  # the same scan, a scan to come, a number that cannot be
        assert answer(controller, FLAT, scanned, printed)["layer_command"] == 1
    assert answer(controller, FLAT, 1, 1)["layer_command"] == 2


def test_repeated_scan_changes_nothing() -> None:
    controller = started(LayerMpcController(JOB))
    first = answer(controller, FLAT, 0, 0)
    second = answer(controller, FLAT + 5e-6, 0, 0)
    for name, value in first.items():
        np.testing.assert_array_equal(second[name], value, err_msg=name)


def test_time_limit_counts_from_the_scan(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []
    planner, estimator = OpenLoop(JOB), HeightEstimator(JOB)

    class Listening:
        def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
            seen.append(elapsed)
            return planner.plan(estimate, layer, last)

    clock = iter([5.0, 7.0, 10.0])  # at the scan, before the plan, after it
    monkeypatch.setattr("inkloop_controller.layer_controller.perf_counter", lambda: next(clock))
    found = answer(started(LayerController(JOB, Listening(), estimator)), FLAT, 0, 0)
    assert (seen, found["solve_time"]) == ([2.0], 5.0)


@pytest.mark.parametrize("make", MAKERS)
def test_commands_count_from_the_layers_there_are(make: Any) -> None:
    controller = started(make(JOB), layer=2)
    assert answer(controller, FLAT, 2, 2)["layer_command"] == 3


@pytest.mark.parametrize("make", MAKERS)
def test_done_is_for_good(make: Any) -> None:
    controller = started(make(JOB, **({"layers": 4} if make is OpenLoopController else {})), layer=4)
    done = answer(controller, JOB.target_height, 4, 4)
    assert done["status"] == Status.DONE
    assert done["layer_command"] == 4
    assert not done["pattern"].any()
    assert answer(controller, FLAT, 5, 5)["status"] == Status.DONE


@pytest.mark.system
@pytest.mark.parametrize("make", MAKERS)
def test_part_is_printed_to_its_end_and_the_same_bits_again(make: Any) -> None:
    controller = make(JOB)
    one, other = (print_part(controller, JOB, variation=0.2, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.height, other.height)
    assert len(one.patterns) >= 4


@pytest.mark.parametrize("options", [{"horizon": 1}, {"horizon": 2, "drop_levels": 2}])
def test_outputs_of_a_restored_state_are_those_it_was_saved_with(options: dict[str, Any]) -> None:
    controller, resumed = (started(LayerMpcController(JOB, **options)) for _ in range(2))
    shown = answer(controller, FLAT, 0, 0)
    assert (shown["drop_level"] != 1).any() == (options["horizon"] == 2)
    resumed.restore(controller.save())  # type: ignore[attr-defined]
    found = answer(resumed, FLAT, 0, 0)  # answered already
    for name in shown:
        np.testing.assert_array_equal(found[name], shown[name], err_msg=name)


def test_droplets_that_are_planned_are_counted_whatever_their_ink() -> None:
    job = block(height=60e-6, inks=(Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), region=Below(1e-9))
    controller = LayerMpcController(job, horizon=2)
    controller.initialize(0, inputs_of(job, FLAT, 0))
    found = controller.do_step(0, SECOND, inputs_of(job, FLAT, 0))
    assert (found["pattern"][job.mask] == 2).all()
    np.testing.assert_array_equal(found["planned_droplets"], np.where(job.mask, 2, 0))


def test_outputs_of_a_step_stay_as_they_are_in_later_steps() -> None:
    controller = started(LayerMpcController(JOB))
    shown = answer(controller, FLAT, 0, 0)
    copies = {name: np.copy(value) for name, value in shown.items()}
    later = answer(controller, JOB.target_height / 2.0, 1, 1)
    assert (later["estimated_height"] != shown["estimated_height"]).any()
    for name in shown:
        np.testing.assert_array_equal(shown[name], copies[name], err_msg=name)


class Bounded:
    """A planner that knows a bound."""

    def __init__(self, bound: float, horizon: int) -> None:
        self.bound, self.horizon = bound, horizon

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        plan = np.zeros((self.horizon, *FLAT.shape), np.int32)
        plan[:, 4, 4] = plan[0, 5, 4] = plan[-1, 4, 5] = 1
        pattern = LayerPlan.of_pattern(plan[0], Objective(4e-6, 5e-6, 7e-6, 3e-6), FLAT, PlanStatus.BUDGET, "rule", 17)
        left_out = LeftOut.STARTS | LeftOut.CERTIFICATE
        return replace(pattern, plan=plan, bound=self.bound, bound_confidence=0.95, left_out=left_out)


@pytest.mark.parametrize(("bound", "valid", "gap"), [(3e-6, 1.0, 0.25), (-np.inf, 0.0, np.nan)])
def test_outputs_tell_what_the_planner_says_of_its_plan(bound: float, valid: float, gap: float) -> None:
    found = answer(started(LayerController(JOB, Bounded(bound, 2), HeightEstimator(JOB))), FLAT, 0, 0)
    shown = [float(found[name]) for name in ("bound_valid", "bound", "gap", "bound_confidence")]
    assert shown == pytest.approx([valid, bound if valid else np.nan, gap, 0.95], rel=1e-12, abs=0.0, nan_ok=True)
    figures = [float(found[name]) for name in ("objective", "objective_error", "objective_deviation")]
    assert figures == [4e-6, 5e-6, 3e-6]
    assert [int(found[name]) for name in ("plan_status", "left_out", "sweeps")] == [2, 18, 17]
    planned = found["planned_droplets"]
    assert (planned[4, 4], planned[5, 4], planned[4, 5], planned.sum()) == (2, 1, 1, 4)


def test_droplets_of_later_layers_are_an_output_of_planners_of_several_layers_alone() -> None:
    for horizon, is_there in ((1, False), (2, True)):
        controller = LayerController(JOB, Bounded(0.0, horizon), HeightEstimator(JOB))
        found = answer(started(controller), FLAT, 0, 0)
        assert found.keys() == {port.name for port in controller.outputs}
        assert ("planned_droplets" in found) == is_there


def test_scans_and_ink_are_taken_as_they_are_where_nothing_is_estimated() -> None:
    controller = started(OpenLoopController(JOB))
    plant, height = LayerModel.of(JOB), FLAT
    for layer in range(3):
        scan = height + np.random.default_rng(layer).normal(0.0, 0.5e-6, FLAT.shape)
        found = answer(controller, scan, layer, layer)
        np.testing.assert_array_equal(found["estimated_height"], scan)
        height = plant.layer(height, found["pattern"], layer + 1, np.full(FLAT.shape, 0.6))
    assert found["volume_scale"] == 1.0


def test_estimator_knows_the_drop_sizes_and_threads_of_the_planner() -> None:
    for options, levels, threads in (({"threads": 1}, 1, 1), ({"drop_levels": 3, "threads": 2}, 3, 2)):
        controller = LayerMpcController(JOB, **options)
        assert (controller._estimator.options["drop_levels"], controller._estimator.options["threads"]) == (
            levels,
            threads,
        )


def test_error_of_the_criterion_brings_no_error_of_others() -> None:
    with pytest.raises(ValueError, match=r"^alpha is 2\.0; [^;]*$"):
        LayerMpcController(JOB, alpha=2.0, horizon=1, certified=True)


class Watched:
    """A planner that looks at what is in memory, and fails in the plans of these numbers."""

    def __init__(self, *failing: int) -> None:
        self._planner, self._failing = OpenLoop(JOB), failing
        self.estimates: list[weakref.ref[Any]] = []
        self.left: list[int] = []

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        self.estimates.append(weakref.ref(estimate))
        self.left.append(sum(other() is not None for other in self.estimates))
        if len(self.left) in self._failing:
            raise MemoryError
        return self._planner.plan(estimate, layer, last)


def test_estimate_before_is_gone_when_a_layer_is_planned() -> None:
    planner = Watched()
    controller = started(LayerController(JOB, planner, HeightEstimator(JOB)))
    for layer in range(3):
        answer(controller, JOB.mask * layer * 7.6e-6, layer, layer)
    assert planner.left == [1, 1, 1]


def test_plan_that_failed_is_made_from_the_same_estimate() -> None:
    """A scan that was taken in twice would count twice."""
    failing, sound = (
        started(LayerController(JOB, Watched(*plans), HeightEstimator(JOB, sensor_noise_std=1e-6)))
        for plans in ([2, 3], [])
    )
    for layer in range(3):
        scan = JOB.mask * layer * 7.4e-6
        expected = answer(sound, scan, layer, layer)
        for _ in range(2 if layer == 1 else 0):
            with pytest.raises(MemoryError):
                answer(failing, scan, layer, layer)
        found = answer(failing, scan, layer, layer)
        for name in expected.keys() - {"solve_time"}:
            np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


def test_state_of_another_grid_is_refused() -> None:
    other = LayerMpcController(block(7, 8))
    with pytest.raises(ComponentError, match=r"of a grid \(7, 8\); needs \(10, 9\)"):
        LayerMpcController(JOB).restore(other.save())
    damaged = bytearray(LayerMpcController(JOB).save())
    damaged[-1] ^= 1
    earlier = io.BytesIO()
    np.savez(earlier, plan=np.zeros((1, JOB.nx, JOB.ny), np.int32), layer_command=0)
    for wrong in (b"nonsense", b"", bytes(damaged), earlier.getvalue()):
        with pytest.raises(ComponentError, match=r"is no state of it.*begin the print again"):
            LayerMpcController(JOB).restore(wrong)


def test_first_scan_without_a_reading_is_refused_and_the_next_one_answered() -> None:
    controller = started(LayerMpcController(JOB))
    with pytest.raises(ComponentError, match=r"layer controller: scan 0: .* less than 2 % of the cells; .* sensor"):
        answer(controller, FLAT, 0, 0, np.zeros(FLAT.shape, np.bool_))
    assert answer(controller, FLAT, 0, 0)["layer_command"] == 1


@pytest.mark.system
def test_part_is_printed_through_cells_that_are_never_measured() -> None:
    """The model fills in for them: the error stays within a few droplets' spread."""
    controller, plant = started(LayerMpcController(JOB)), LayerModel.of(JOB)
    valid = np.ones(FLAT.shape, np.bool_)
    valid[4:6, 4:6] = False
    height = FLAT
    for layer in range(20):
        outputs = answer(controller, np.where(valid, height, 0.0), layer, layer, valid)
        if outputs["status"] == Status.DONE:
            break
        height = plant.layer(height, outputs["pattern"], layer + 1, np.full(height.shape, 0.9))
    assert outputs["status"] == Status.DONE
    assert np.abs(JOB.target_height - height)[JOB.mask].max() < 8e-6


def test_bound_counts_only_with_a_relaxation() -> None:
    without = answer(started(LayerMpcController(JOB)), FLAT, 0, 0)
    assert not without["bound_valid"]
    assert np.isnan(without["bound"])
    bounded = answer(started(LayerMpcController(JOB, horizon=1, relaxation="ipopt")), FLAT, 0, 0)
    assert bounded["bound_valid"]
    assert bounded["bound"] <= bounded["objective"]


@pytest.mark.system
@pytest.mark.parametrize(
    ("fields", "options"),
    [
        pytest.param({"passes": 4, "pass_rotation": 1}, {}, marks=pytest.mark.long),
        ({"inks": (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), "region": Below(20e-6)}, {"region_test": "either"}),
        pytest.param({}, {"drop_levels": 3}, marks=pytest.mark.long),
    ],
    ids=["four passes", "two inks", "grey"],
)
def test_controller_restored_after_every_layer_prints_the_same_bits(fields: Any, options: Any) -> None:
    """Noisy scans, droplets that vary, and a cell that is dead from layer 2 on."""
    job = block(height=45e-6, **fields)
    plant, droplets, sensor = LayerModel.of(job), np.random.default_rng(7), np.random.default_rng(8)
    steady, resumed = (LayerMpcController(job, adapt_ink="full", annealing_sweeps=10, **options) for _ in range(2))
    height = np.zeros((job.nx, job.ny))
    for controller in (steady, resumed):
        controller.initialize(0, inputs_of(job, height, 0))
    dead_cells = []
    for layer in range(60):
        scan = height + sensor.normal(0.0, 0.3e-6, height.shape)
        outputs = answer(steady, scan, layer, layer)
        again = answer(resumed, scan, layer, layer)
        for name in outputs.keys() - {"solve_time"}:
            np.testing.assert_array_equal(again[name], outputs[name], err_msg=f"{name} of layer {layer}")
        saved, resumed = resumed.save(), LayerMpcController(job, adapt_ink="full", annealing_sweeps=10, **options)
        resumed.restore(saved)
        dead_cells.append(int(outputs["dead_cells"]))
        if outputs["status"] == Status.DONE:
            break
        factor = outputs["drop_level"] * (1.0 - 0.2 * droplets.random(height.shape))
        factor[5, 5] *= 1e-9 if layer > 1 else 1.0
        height = plant.layer(height, outputs["pattern"], layer + 1, factor)
    assert outputs["status"] == Status.DONE
    assert max(dead_cells) == 1


@pytest.mark.parametrize("make", MAKERS)
def test_before_the_first_scan_nothing_is_known_and_nothing_is_jetted(make: Any) -> None:
    controller = make(JOB)
    found = dict(controller.initialize(0, inputs_of(JOB, FLAT, 3)))
    starts = {port.name: port.start for port in controller.outputs}
    assert starts.keys() == found.keys()
    assert ("planned_droplets" in found) == (make is LayerMpcController)
    assert np.isnan([starts["bound"], starts["gap"]]).all()
    expected = dict.fromkeys(found, 0.0) | {
        "layer_command": 3,
        "drop_level": 1,
        "bound": np.nan,
        "gap": np.nan,
        "bound_confidence": 1.0,
        "volume_scale": 1.0,
        "scan_surprise": 1.0,
    }
    for name, value in found.items():
        np.testing.assert_array_equal(np.asarray(value, np.float64), np.full(value.shape, expected[name]), name)


def test_outputs_report_cells_and_numbers_of_the_estimate() -> None:
    """A cell 60 um higher than the target of its part in three scans, and one that is never seen."""
    options = {"register_scans": False, "untrusted_layers": 0, "flat_ground": False}
    controller, plant = started(LayerMpcController(JOB, **options)), LayerModel.of(JOB)
    i, j = (int(each[4]) for each in np.nonzero(JOB.mask))
    valid = np.ones(FLAT.shape, np.bool_)
    valid[tuple(each[9] for each in np.nonzero(JOB.mask))] = False
    height, found = FLAT, answer(controller, FLAT, 0, 0, valid)
    for layer in (1, 2, 3):
        height = plant.layer(height, found["pattern"], layer)
        height[i, j] = JOB.target_height[i, j] + 60e-6
        found = answer(controller, height, layer, layer, valid)
    assert (found["height_excess_i"], found["height_excess_j"]) == (i, j)
    assert found["height_excess"] == pytest.approx(60e-6, rel=0.05, abs=0.0)
    assert found["untrusted_cells"] == 1
    assert found["dead_cells"] == 0
    assert found["status"] == Status.UNTRUSTED
    assert int(found["untrusted_reasons"]) == UntrustedReason.UNSEEN | UntrustedReason.HIGH
    assert not found["scan_corrected"]
    assert not found["stop_reason"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_ground_of_the_first_scan_is_reported_along_x_and_y(sign: float) -> None:
    u, w = (np.linspace(-1.0, 1.0, count) for count in FLAT.shape)
    ground = sign * (5e-6 + 1e-6 * u[:, None] - 2e-6 * w)
    found = answer(started(LayerMpcController(JOB)), ground, 0, 0)
    reported = [float(found[f"ground_{name}"]) for name in ("offset", "rise_x", "rise_y")]
    assert reported == pytest.approx(sign * np.array([5e-6, 2e-6, -4e-6]), rel=1e-2, abs=0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"measured_height": np.zeros((3, 4))}, "scan 0: measured_height has shape (3, 4); needs (10, 9)"),
        ({"valid": np.ones((3, 4), np.bool_)}, "scan 0: valid has shape (3, 4); needs (10, 9)"),
        (
            {"measured_height": np.where(np.arange(9) == 7, np.nan, FLAT)},
            "scan 0: measured_height is nan at cell (0, 7), which is marked valid",
        ),
        (
            {"measured_height": np.where(np.arange(9) == 7, 12.0, FLAT)},
            "scan 0: measured_height is 12 at cell (0, 7), which is marked valid",
        ),
        ({"measured_height": np.where(np.arange(9) == 7, -1.1, FLAT)}, "needs a height in metres, within 0.4 m"),
    ],
)
def test_scan_that_is_none_is_refused_and_nothing_is_lost(change: dict[str, Any], message: str) -> None:
    controller, other = (started(LayerMpcController(JOB)) for _ in range(2))
    with pytest.raises(ComponentError, match=re.escape(message)):
        controller.do_step(0, SECOND, inputs_of(JOB, FLAT, 0) | change)
    found, expected = (answer(each, FLAT, 0, 0) for each in (controller, other))
    np.testing.assert_array_equal(found["pattern"], expected["pattern"])
    assert found["layer_command"] == 1


@pytest.mark.parametrize("reading", [np.nan, 12.0])
def test_cell_that_is_not_valid_may_hold_any_reading(reading: float) -> None:
    controller, valid = started(LayerMpcController(JOB)), np.ones(FLAT.shape, np.bool_)
    valid[4, 4] = False
    assert answer(controller, np.where(valid, FLAT, reading), 0, 0, valid)["layer_command"] == 1


def test_print_without_any_reading_lives_on_predictions_and_is_untrusted_after_five_layers() -> None:
    job = block(14, 14, 60e-6)
    controller = LayerMpcController(job, horizon=1)
    blank, nothing = np.zeros((14, 14)), np.zeros((14, 14), np.bool_)
    controller.initialize(0, inputs_of(job, blank, 0))
    statuses = []
    for layer in range(40):
        outputs = controller.do_step(0, SECOND, inputs_of(job, blank, layer, None if layer == 0 else nothing))
        if outputs["status"] == Status.DONE:
            break
        statuses.append(int(outputs["status"]))
        assert outputs["stop_reason"] == 0
    assert statuses[:6] == [Status.IDLE] * 6
    assert set(statuses[6:]) == {Status.UNTRUSTED}
    assert layer < 20

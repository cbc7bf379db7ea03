"""Invariants of a step of the controller: when it is due, what it takes from the state before, and what it shows."""

from __future__ import annotations

from ctypes import Structure, c_double, c_int64
from math import nan
from typing import Any, ClassVar

import numpy as np
import pytest

from inkloop.component import Ink, Job, Status
from inkloop_controller.core.layer_step import Block, LayerStep
from inkloop_controller.core.library import PlanFiguresStruct
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import HeightEstimator
from inkloop_controller.model import LayerModel
from support.closed_loop import block
from support.half_spaces import Above

REPAIRED, DONE = 1, 7
JOB = block(12, 11)
FLAT, SEEN = np.zeros((12, 11)), np.ones((12, 11), np.bool_)


def numbers(scanned: int, printed: int, **others: Any) -> dict[str, Any]:
    return {"layers_scanned": scanned, "layers_printed": printed, **others}


def plan_figures(status: int = REPAIRED, value: float = 2e-6) -> Any:
    return PlanFiguresStruct(
        status=status, objective=(value, 3e-6, 0.0, 1e-6), bound=nan, bound_confidence=1.0, seconds=0.5
    )


def taken(step: LayerStep, state: Block, layer: int, height: Any, plan: Any, status: int = REPAIRED) -> Block:
    """The state after the scan of a layer that is answered by a plan."""
    assert step.is_due(numbers(layer, layer), state)
    after, lacks_plan = step.begin(height, SEEN, state)
    assert lacks_plan
    return step.take(after, plan, plan_figures(status))


def full(layers: int = 1, job: Job = JOB) -> Any:
    return np.repeat(job.mask[None], layers, axis=0).astype(np.int32)


def printed(step: LayerStep, layers: int, stuck_from: int = 99) -> tuple[Block, Any]:
    """The state before the scan of the last layer of a print of full ones, and that scan; stuck: nothing grows."""
    state, height, plant = step.new_state(1, 0), FLAT, LayerModel.of(JOB)
    for layer in range(layers):
        state = taken(step, state, layer, height, full())
        height = plant.layer(height, full()[0], layer + 1) if layer + 1 < stuck_from else height
    return state, height


@pytest.mark.parametrize("scanned", [-1, 0, 1, 2, 3])
@pytest.mark.parametrize("layers_printed", [0, 1, 2, 3])
def test_step_is_due_for_a_new_scan_of_the_layer_commanded_and_for_no_other(scanned: int, layers_printed: int) -> None:
    step = LayerStep(JOB)
    state, _ = printed(step, 2)  # layers 1 and 2 are commanded, scan 1 is answered
    assert step.is_due(numbers(scanned, layers_printed), state) == (scanned == layers_printed == 2)


def test_no_step_is_due_without_inputs() -> None:
    step = LayerStep(JOB)
    assert not step.is_due({}, step.new_state(1, 0))


@pytest.mark.parametrize("status", range(8))
def test_every_plan_commands_a_layer_but_the_one_that_ends_the_print(status: int) -> None:
    step = LayerStep(JOB)
    found = step.outputs(taken(step, step.new_state(1, 0), 0, FLAT, full(), status))
    assert found["layer_command"] == (0 if status == DONE else 1)


def test_state_before_is_left_as_it_was() -> None:
    step = LayerStep(JOB)
    before, height = printed(step, 2)
    copy = before.copy()
    assert step.is_due(numbers(2, 2), before)
    after, _ = step.begin(height, SEEN, before)
    step.take(after, full(), plan_figures())
    np.testing.assert_array_equal(before, copy)


def test_plan_that_failed_is_begun_again_from_the_same_estimate() -> None:
    step = LayerStep(JOB)
    before, height = printed(step, 2)
    assert step.is_due(numbers(2, 2), before)
    after, _ = step.begin(height, SEEN, before)
    assert step.is_due(numbers(2, 2), after)
    again, lacks_plan = step.begin(height + 5e-6, SEEN, after)
    assert lacks_plan
    np.testing.assert_array_equal(again, after)


def test_state_takes_a_plan_of_another_number_of_layers_with_the_same_estimate() -> None:
    step = LayerStep(JOB)
    state, _ = printed(step, 1)
    longer = step.take(state, full(3), plan_figures())
    assert (step.layers_of(state), step.layers_of(longer)) == (1, 3)
    np.testing.assert_array_equal(step.plan_in(longer), full(3))
    np.testing.assert_array_equal(step.estimate_in(longer), step.estimate_in(state))


@pytest.mark.parametrize("shape", [(0, 12, 11), (1, 11, 12), (2, 12, 10)])
def test_plan_of_another_grid_or_of_no_layer_is_refused_and_the_state_is_left(shape: tuple[int, ...]) -> None:
    step = LayerStep(JOB)
    state, _ = printed(step, 1)
    before = state.copy()
    with pytest.raises(ValueError, match="plan has shape"):
        step.take(state, np.zeros(shape, np.int32), plan_figures())
    np.testing.assert_array_equal(state, before)


def test_bytes_of_another_grid_or_size_are_no_state() -> None:
    step, other = LayerStep(JOB), LayerStep(block(11, 12))
    state = step.new_state(2, 0)
    assert step.layers_of(state) == 2
    for wrong in (other.new_state(2, 0), state[:-1].copy(), state[:20].copy(), np.zeros_like(state)):
        assert step.layers_of(wrong) == 0


@pytest.mark.parametrize("inks", [1, 2])
def test_outputs_show_material_and_drops_of_the_first_layer_of_the_plan(inks: int) -> None:
    """Kind (drops - 1) inks + ink; a droplet of a plan is one more."""
    job = block(12, 11, inks=(Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))[:inks])
    step, rng = LayerStep(job, drop_levels=3), np.random.default_rng(0)
    pattern = rng.integers(0, inks + 1, (12, 11))
    level = np.where(pattern > 0, rng.integers(1, 4, (12, 11)), 1)
    first = np.where(pattern > 0, (level - 1) * inks + pattern, 0)
    plan = np.stack([first, np.zeros_like(first)]).astype(np.int32)
    found = step.outputs(taken(step, step.new_state(2, 0), 0, FLAT, plan))
    np.testing.assert_array_equal(found["pattern"], pattern)
    np.testing.assert_array_equal(found["drop_level"], level)
    assert (found["objective"], found["solve_time"], found["bound_valid"]) == (2e-6, 0.5, False)


def test_layer_of_several_drops_is_estimated_with_their_volume() -> None:
    step = LayerStep(JOB, drop_levels=2)
    state = taken(step, step.new_state(1, 0), 0, FLAT, 2 * full())
    height = LayerModel.of(JOB).layer(FLAT, full()[0], 1, np.full(FLAT.shape, 2.0))
    assert step.is_due(numbers(1, 1), state)
    unseen, _ = step.begin(FLAT, ~SEEN, state)
    np.testing.assert_allclose(step.outputs(unseen)["estimated_height"], height, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("passes", [1, 4])
def test_layer_is_predicted_with_its_inks_its_drops_and_the_order_of_its_passes(passes: int) -> None:
    """The order of layer 1 is not that of its neighbours."""
    job = block(12, 11, inks=(Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), passes=passes, pass_order=2, pass_rotation=1)
    step, model, rng = LayerStep(job, drop_levels=2), LayerModel.of(job), np.random.default_rng(3)
    pattern, level = rng.integers(0, 3, (12, 11), dtype=np.int32), rng.integers(1, 3, (12, 11), dtype=np.int32)
    plan = np.where(pattern > 0, 2 * (level - 1) + pattern, 0).astype(np.int32)[None]
    assert (model.colours(1) == model.colours(2)) == (passes == 1)
    state = taken(step, step.new_state(1, 0), 0, FLAT, plan)
    assert step.is_due(numbers(1, 1), state)
    unseen, _ = step.begin(FLAT, ~SEEN, state)
    height = model.layer(FLAT, pattern, 1, level.astype(np.float64))
    np.testing.assert_allclose(step.outputs(unseen)["estimated_height"], height, rtol=1e-12, atol=1e-18)


def test_nothing_is_learnt_from_a_layer_that_is_unknown() -> None:
    step = LayerStep(JOB)
    state, height = printed(step, 2)
    volumes = []
    for is_unknown in (False, True):
        assert step.is_due(numbers(2, 2, layer_unknown=is_unknown), state)
        after, _ = step.begin(0.7 * height, SEEN, state)
        volumes.append(float(step.outputs(after)["volume_scale"]))
    before = float(step.outputs(state)["volume_scale"])
    assert volumes[0] < before - 0.001
    assert volumes[1] == before


@pytest.mark.parametrize(("status", "shown"), [(DONE, Status.DONE), (REPAIRED, Status.UNTRUSTED)])
def test_print_that_is_not_trusted_ends_when_it_is_done(status: int, shown: Status) -> None:
    step = LayerStep(JOB)
    state = taken(step, step.new_state(1, 0), 0, FLAT, full(), status)
    known_in(step.estimate_in(state)).trust.unseen_cells = 1
    assert step.outputs(state)["status"] == shown


@pytest.mark.parametrize(("region", "layer"), [(Above(1.0), 7.15e-6), (None, 7.6e-6)])
def test_height_that_was_not_measured_is_known_within_a_nominal_layer(region: Any, layer: float) -> None:
    """The mean over the inks where there is a region, or that of the first ink."""
    job = block(12, 11, inks=(Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), region=region)
    valid = SEEN.copy()
    valid[5, 5] = False
    found = HeightEstimator(job, flat_ground=False).first(FLAT, valid)
    assert found.height_variance[5, 5] == pytest.approx(layer**2, rel=1e-12, abs=0.0)
    assert found.height_variance[6, 5] < 0.5 * layer**2


@pytest.mark.parametrize(("std", "variance"), [(1e-6, 1.03e-12), (0.0, 0.03e-12), (None, 0.03e-12)])
def test_noise_of_a_reading_is_that_of_the_sensor_and_of_its_steps(std: float | None, variance: float) -> None:
    """Steps of 0.6 um have a variance of a twelfth of their square. What is not known is that of the steps at least."""
    found = HeightEstimator(JOB, sensor_noise_std=std, sensor_resolution=0.6e-6).first(FLAT, SEEN)
    assert found.figures.noise_std == pytest.approx(np.sqrt(variance), rel=1e-12, abs=0.0)


def stopped(step: LayerStep) -> Block:
    """A state after scans on which nothing grows."""
    state, height = printed(step, 2, stuck_from=1)
    for layer in range(2, 9):
        assert step.is_due(numbers(layer, layer), state)
        state, lacks_plan = step.begin(height, SEEN, state)
        if not lacks_plan:
            return state
        state = step.take(state, full(), plan_figures())
    raise AssertionError("never stopped")


def test_print_that_is_stopped_jets_nothing_until_a_person_has_looked() -> None:
    step = LayerStep(JOB)
    state = stopped(step)
    shown = step.outputs(state)
    assert (shown["stop_reason"], shown["status"]) == (UntrustedReason.NO_GROWTH, Status.UNTRUSTED)
    assert not shown["pattern"].any()
    layer = int(shown["layer_command"])
    assert not step.is_due(numbers(layer, layer), state)
    assert step.is_due(numbers(layer, layer, looked_at=True), state)
    after, lacks_plan = step.begin(FLAT, SEEN, state)
    assert lacks_plan
    found = step.outputs(step.take(after, full(), plan_figures()))
    assert (found["stop_reason"], found["layer_command"]) == (0, layer + 1)
    np.testing.assert_array_equal(found["pattern"], full()[0])


def test_look_while_the_scan_is_not_the_one_asked_for_lets_the_print_go_on_with_the_next_one() -> None:
    step = LayerStep(JOB)
    state = stopped(step)
    layer = int(step.outputs(state)["layer_command"])
    assert step.is_due(numbers(layer - 1, layer, looked_at=True), state)
    after, lacks_plan = step.begin(FLAT, SEEN, state)
    assert not lacks_plan
    assert step.outputs(after)["stop_reason"] == 0
    assert step.is_due(numbers(layer, layer), after)


def test_print_that_is_to_continue_is_never_stopped() -> None:
    step = LayerStep(JOB, on_doubt="continue")
    with pytest.raises(AssertionError, match="never stopped"):
        stopped(step)


class Registration(Structure):
    """`Registration` of surface_estimate.h."""

    _fields_: ClassVar = [
        *(("estimate", c_double * 7), ("covariance", c_double * 49), ("steps", c_double * 2), ("odds", c_double)),
        *(("misfits", c_double * 3), ("fits", c_int64), ("is_displaced", c_int64), ("is_shifted", c_int64)),
    ]


class LoopTrust(Structure):
    """`LoopTrust` of surface_estimate.h."""

    _fields_: ClassVar = [
        ("ground", c_double * 3),
        *((name, c_double) for name in ("early", "surprise", "spill", "blind_share", "excess", "rise")),
        *(("doubts", c_double * 9), ("volume_doubt", c_double)),
        *((name, c_int64) for name in ("excess_cell", "rise_cell", "layers", "capped_cells", "unseen_cells")),
        *((name, c_int64) for name in ("high_cells", "blind_layers", "ground_wrong", "stop", "stop_layer")),
        *((name, c_int64) for name in ("is_looked_at", "is_volume_believed", "transform")),
        ("stop_figure", c_double),
    ]


class Knowledge(Structure):
    """The first numbers of `Knowledge` of surface_estimate.h."""

    _fields_: ClassVar = [("registration", Registration), ("trust", LoopTrust), ("share", c_double * 6)]


def known_in(block: Any) -> Knowledge:
    """Its place in an estimate."""
    return Knowledge.from_buffer(block)


def test_every_figure_of_the_estimate_has_its_output() -> None:
    """The grid has 12 x 11 cells: u and w change by 1 over 5.5 and over 5 cells. Lengths of the geometry are in cells
    of the estimate, and in metres of an output."""
    step = LayerStep(JOB)
    state, _ = printed(step, 1)
    block = step.estimate_in(state)
    known = known_in(block)
    known.registration.estimate[:] = (0.5, -0.25, 0.03, -0.04, 0.05, 0.06, 4.0)
    known.registration.covariance[0], known.registration.covariance[8], known.registration.covariance[48] = (
        0.01,
        0.04,
        25.0,
    )
    known.registration.fits = known.registration.is_displaced = 1
    known.share[0] = 0.9
    for name, value in {
        "surprise": 1.44, "blind_share": 0.125, "excess": 2e-6, "rise": 3e-6, "excess_cell": 3 * 11 + 7,
        "rise_cell": 5 * 11 + 2, "capped_cells": 4, "unseen_cells": 6, "stop_layer": 8, "transform": 5,
        "stop_figure": 1.75, "stop": UntrustedReason.TURNED,
    }.items():  # fmt: skip
        setattr(known.trust, name, value)
    known.trust.ground[:] = (1e-6, -2e-6, 4e-6)
    HeightEstimator(JOB).estimate(block).state["dead_evidence"][:2, 0] = 20.0
    found, reasons = step.outputs(state), UntrustedReason
    expected = {
        "volume_scale": 0.9, "scan_surprise": 1.2, "blind_share": 0.125, "ink_excess": 2e-6, "height_excess": 3e-6,
        "ink_excess_i": 3, "ink_excess_j": 7, "height_excess_i": 5, "height_excess_j": 2, "dead_cells": 2,
        "capped_cells": 4, "untrusted_cells": 6, "stop_layer": 8, "stop_transform": 5, "stop_figure": 1.75,
        "stop_reason": int(reasons.TURNED), "untrusted_reasons": int(reasons.TURNED | reasons.UNSEEN | reasons.INK),
        "ground_offset": 1e-6, "ground_rise_x": -2e-6, "ground_rise_y": 4e-6, "scan_corrected": 1,
        "scan_shift_x": 0.5 * JOB.pitch, "scan_shift_y": -0.25 * JOB.pitch, "scan_shift_std": 0.2 * JOB.pitch,
        "scan_spot_radius": 2.0 * JOB.pitch, "scan_spot_std": 1.0 * JOB.pitch,
        "scan_rotation": (0.05 / 5.5 + 0.04 / 5.0) / 2.0, "scan_magnification": (0.03 / 5.5 + 0.06 / 5.0) / 2.0,
    }  # fmt: skip
    assert {name: float(found[name]) for name in expected} == pytest.approx(expected, rel=1e-12, abs=0.0)


def test_every_figure_of_the_plan_has_its_output() -> None:
    step = LayerStep(JOB)
    figures = PlanFiguresStruct(
        status=3,
        left_out=5,
        sweeps=17,
        objective=(2e-6, 3e-6, 4e-6, 1e-6),
        bound=1.5e-6,
        bound_confidence=0.9,
        seconds=0.5,
    )
    state, _ = printed(step, 1)
    found = step.outputs(step.take(state, full(), figures))
    expected = {
        "objective": 2e-6, "objective_error": 3e-6, "objective_deviation": 1e-6, "bound": 1.5e-6, "bound_valid": 1,
        "plan_status": 3, "left_out": 5, "sweeps": 17, "solve_time": 0.5, "status": Status.IDLE,
    }  # fmt: skip
    assert {name: float(found[name]) for name in expected} == pytest.approx(expected, rel=1e-12, abs=0.0)

"""The controller as an FMU: what its variables and calls add to the step that it shares with the one in Python.

tests/property/test_controller_twins.py compares both on random jobs, options and prints.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Status
from inkloop.components import catalog
from inkloop.errors import ComponentError
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND, block, inputs_of
from support.fmus.fmu_driver import DISCARD, ERROR, EVERY_FORM, OK, Driver
from support.small_block import assert_same_layers, printed

OF_PYTHON_ALONE = {"bound", "bound_confidence", "gap", "planned_droplets", "solve_time"}


def planned_ahead(controller: Any) -> tuple[bool, int]:
    """Whether the plant is a foreign one, and the layers of the last plan that jet."""
    assert isinstance(controller, LayerController)
    step, state = controller._step, controller._state
    estimate = controller._estimator.estimate(step.estimate_in(state))
    return estimate.figures.is_foreign, int(step.plan_in(state).any(axis=(1, 2)).sum())


def test_plans_on_a_plant_of_other_droplets_look_less_far_ahead_alike() -> None:
    job, options = block(13, 12, height=25e-6), {"annealing_sweeps": 1, "adapt_ink": "off"}
    plant = LayerModel((Ink(3.2e-6, 0.9e-6, 0.2e-6),))
    controllers = [catalog.make(kind, job, options) for kind in ("LayerMpc", "LayerController")]
    height, ahead = np.zeros((13, 12)), set()
    for controller in controllers:
        controller.initialize(0, inputs_of(job, height, 0))
    for layer in range(20):
        inputs = inputs_of(job, height, layer)
        one, other = (controller.do_step(layer * SECOND, SECOND, inputs) for controller in controllers)
        for name in one.keys() - OF_PYTHON_ALONE:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        ahead.add(planned_ahead(controllers[0]))
        if other["status"] == Status.DONE:
            break
        height = plant.layer(height, np.asarray(other["pattern"]), layer + 1)
    assert (False, 5) in ahead
    assert (True, 3) in ahead
    assert max(layers for is_foreign, layers in ahead if is_foreign) == 3


@EVERY_FORM
def test_every_form_prints_the_same_layers_in_our_master(form: str) -> None:
    assert_same_layers(printed(controller=("LayerController", {"fmi": form})), printed())


@EVERY_FORM
@pytest.mark.parametrize("asked", [{}, {"is_timed": True}])
def test_clock_is_read_only_where_it_is_asked_for(form: str, asked: dict[str, bool]) -> None:
    with Driver("LayerController", form).start({"layers_scanned": 0, **asked}) as fmu:
        assert fmu.step(0.0) == OK
        assert (fmu.get("solve_time") > 0.0) == bool(asked)


@EVERY_FORM
def test_plan_that_ran_out_of_time_is_still_one(form: str) -> None:
    with Driver("LayerController", form, 12, 12).start({"layers_scanned": 0, "time_limit": 1e-9}) as fmu:
        assert fmu.step(0.0) == OK
        assert (fmu.get("plan_status"), fmu.get("left_out")) == (5, 15)
        assert fmu.get("layer_command") == 1
        assert fmu.get("pattern").all()


@EVERY_FORM
@pytest.mark.parametrize(
    ("name", "value", "right", "message"),
    [
        ("mask", False, True, "mask marks no cell; expected the cells of the part"),
        ("drop_levels", 9, 8, "drop_levels is 9 with 2 inks; expected at most 8"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_with_a_message(
    form: str, name: str, value: int, right: int, message: str
) -> None:
    with Driver("LayerController", form) as fmu:
        assert max(fmu.set("inks", 2), fmu.set("mask", True), fmu.set(name, value), fmu.enter()) == OK
        assert fmu.exit() in (DISCARD, ERROR)
        assert fmu.messages[-1].endswith(message)
        assert max(fmu.set(name, right), fmu.exit()) == OK


@EVERY_FORM
@pytest.mark.parametrize("high", ["measured_height", "target_height"])
def test_heights_beyond_the_search_are_refused_and_change_nothing(form: str, high: str) -> None:
    """One cell of the last row, by droplets of the thicker ink, which leave room for 0.34 m."""
    thick = "a" if high == "measured_height" else "b"
    ink = {f"h{k + 1}_{thick}": height for k, height in enumerate((1e-3, 7.5e-4, 0.0))}
    for height in (0.35, 0.33):
        map_ = np.zeros((3, 3))
        map_[2, 1] = height
        parameters = {**ink, "inks": 2, "layers_scanned": 0, "horizon": 5, "drop_levels": 2, high: map_}
        with Driver("LayerController", form, 3, 3).start(parameters) as fmu:
            before = fmu.save()
            if height < 0.34:
                assert fmu.step(0.0) == OK
                continue
            assert fmu.step(0.0) in (DISCARD, ERROR)
            assert fmu.save() == before
            if form != "fmi2":
                heights = ("0.35", "3.8e-05") if thick == "a" else ("0", "0.35")
                assert "cell (2, 1) is estimated at {} m, its target is {} m; ".format(*heights) in fmu.messages[-1]
                assert "expected heights within 0.34 m with 5 layers to come" in fmu.messages[-1]


@EVERY_FORM
def test_first_scan_without_a_reading_is_refused_and_changes_nothing(form: str) -> None:
    with Driver("LayerController", form).start({"valid": False, "layers_scanned": 7, "layers_printed": 7}) as fmu:
        before = fmu.save()
        assert fmu.step(0.0) in (DISCARD, ERROR)
        assert fmu.save() == before
        if form != "fmi2":
            assert "scan 7, the first one, has readings on less than 2 %" in fmu.messages[-1]


def test_commands_count_from_the_layers_that_are_printed() -> None:
    job = block()
    controller = catalog.make("LayerController", job, {})
    inputs = inputs_of(job, np.zeros((10, 9)), 41)
    assert controller.initialize(0, inputs)["layer_command"] == 0  # the printer may derive its number from it
    assert controller.do_step(0, SECOND, inputs)["layer_command"] == 42
    with pytest.raises(ComponentError, match="measured_height"):
        controller.do_step(SECOND, SECOND, inputs_of(job, np.full((10, 9), np.nan), 42))


def test_droplets_that_are_called_sure_leave_nothing_to_chance() -> None:
    """With `droplet_std` 0 the objective is that of the predicted surface, however much droplets are seen to vary."""
    job = block(12, 11, height=60e-6)
    model, rng = LayerModel.of(job), np.random.default_rng(3)
    controller = catalog.make("LayerController", job, {"horizon": 1, "adapt_ink": "off", "droplet_std": 0.0})
    height = np.zeros((12, 11))
    controller.initialize(0, inputs_of(job, height, 0))
    for layer in range(5):
        found = controller.do_step(layer * SECOND, SECOND, inputs_of(job, height, layer))
        pattern = np.asarray(found["pattern"])
        lack = (job.target_height - model.layer(found["estimated_height"], pattern, layer + 1))[job.mask]
        expected = 0.8 * np.abs(lack).mean() + 0.2 * lack.std()
        assert float(found["objective"]) == pytest.approx(expected, rel=1e-9, abs=0.0)
        height = model.layer(height, pattern, layer + 1, 1.0 - 0.4 * rng.random(height.shape))
    controller.terminate()


def layer_by_layer(controller: Any, fmu: Driver, alphas: dict[int, float]) -> int:
    """Number of layers of a print in which `fmu` is tuned to alpha from a layer on, and both answer alike."""
    job, plant = block(12, 11, height=40e-6), LayerModel.of(block(12, 11, height=40e-6))
    height = np.zeros((12, 11))
    controller.initialize(0, inputs_of(job, height, 0))
    for layer in range(30):
        inputs = inputs_of(job, height, layer)
        if layer + 1 in alphas:
            assert fmu.set("alpha", alphas[layer + 1]) == OK
        assert max(fmu.set(name, value) for name, value in inputs.items()) == OK
        assert fmu.step(float(layer)) == OK
        answer = controller.do_step(layer * SECOND, SECOND, inputs)
        for name in ("pattern", "layer_command", "status", "objective", "volume_scale", "estimated_height"):
            np.testing.assert_array_equal(fmu.get(name), answer[name], err_msg=f"{name} after scan {layer}")
        if answer["status"] == Status.DONE:
            return layer
        factor = 1.0 - 0.2 * np.random.default_rng(layer).random(height.shape)
        height = plant.layer(height, answer["pattern"], layer + 1, factor)
    raise AssertionError("not done after 30 layers")


@EVERY_FORM
def test_alpha_tuned_between_steps_is_a_schedule_of_the_python_controller(form: str) -> None:
    alphas, job = {1: 0.9, 3: 0.3, 5: 1.0}, block(12, 11, height=40e-6)
    python = catalog.make("LayerMpc", job, {"alpha": list(alphas.items()), "horizon": 2, "annealing_sweeps": 1})
    fixed = catalog.make("LayerMpc", job, {"alpha": 0.9, "horizon": 2, "annealing_sweeps": 1})
    work = {"horizon": 2, "annealing_sweeps": 1}
    parameters = {"target_height": job.target_height, "mask": job.mask, "flat_ground": True, **work}
    with Driver("LayerController", form, 12, 11).start(parameters) as fmu:
        assert layer_by_layer(python, fmu, alphas) > 5
    with Driver("LayerController", form, 12, 11).start(parameters) as fmu, pytest.raises(AssertionError):
        layer_by_layer(fixed, fmu, alphas)


@EVERY_FORM
def test_print_that_another_instance_continues_after_each_layer_is_the_same(form: str) -> None:
    job, plant = block(12, 11, height=40e-6), LayerModel.of(block(12, 11, height=40e-6))
    work = {"horizon": 2, "annealing_sweeps": 1}
    python = catalog.make("LayerMpc", job, work)
    parameters = {"target_height": job.target_height, "mask": job.mask, "flat_ground": True, **work}
    height, saved = np.zeros((12, 11)), b""
    python.initialize(0, inputs_of(job, height, 0))
    for layer in range(30):
        inputs = inputs_of(job, height, layer)
        answer = python.do_step(layer * SECOND, SECOND, inputs)
        with Driver("LayerController", form, 12, 11).start(parameters) as fmu:
            assert not saved or fmu.restore(saved) == OK
            assert max(fmu.set(name, value) for name, value in inputs.items()) == OK
            assert fmu.step(float(layer)) == OK
            np.testing.assert_array_equal(fmu.get("pattern"), answer["pattern"])
            np.testing.assert_array_equal(fmu.get("estimated_height"), answer["estimated_height"])
            saved = fmu.save()
        if answer["status"] == Status.DONE:
            break
        height = plant.layer(height, answer["pattern"], layer + 1, 1.0 - 0.2 * np.indices(height.shape)[0] / 12)
    assert layer > 5

"""The controller as an FMU: what its variables and calls add to the step that it shares with the one in Python.

tests/property/test_controller_twins.py compares both on random jobs, options and prints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Ink, Job, Status
from inkloop.components import catalog
from inkloop.errors import ComponentError
from inkloop.geometry import PipeJunction
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND, block, inputs_of, print_part
from support.fmus.fmu_driver import DISCARD, ERROR, EVERY_FORM, OK, Driver
from support.small_block import ANNEALING_SWEEPS, assert_same_layers, printed
from support.small_block import job as block_job

OF_PYTHON_ALONE = {"bound", "bound_confidence", "gap", "solve_time"}


def twins(job: Job, options: dict[str, Any]) -> tuple[Component, Component]:
    """The Python controller with options, and the FMU with the same ones."""
    return catalog.make("LayerMpc", job, options), catalog.make("LayerController", job, options)


def assert_same_print(one: Component, other: Component, job: Job) -> int:
    """The number of layers of a print of 20 % variation, which must be the same by both."""
    first, second = (print_part(controller, job, variation=0.2) for controller in (one, other))
    np.testing.assert_array_equal(first.patterns, second.patterns)
    for name in first.outputs.keys() - OF_PYTHON_ALONE:
        np.testing.assert_array_equal(first.outputs[name], second.outputs[name], err_msg=name)
    return len(first.patterns)


def planned_ahead(controller: Any) -> tuple[bool, int]:
    """Whether the plant is a foreign one, and the layers of the last plan that jet."""
    assert isinstance(controller, LayerController)
    step, state = controller._step, controller._state
    estimate = controller._estimator.estimate(step.estimate_in(state))
    return estimate.figures.is_foreign, int(step.plan_in(state).any(axis=(1, 2)).sum())


def test_plans_on_a_plant_of_other_droplets_look_less_far_ahead_alike() -> None:
    job, options = block(13, 12, height=25e-6), {"annealing_sweeps": 1, "adapt_ink": "off"}
    plant = LayerModel((Ink(3.2e-6, 0.9e-6, 0.2e-6),))
    controllers, height, ahead = twins(job, options), np.zeros((13, 12)), set()
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


def layers(forms: tuple[str, str, str], step: float) -> Iterator[Any]:
    """Surfaces of a print by our three FMUs, driven by FMPy's calls alone, each on what the others gave last."""
    job = block_job()
    ink = {f"h{order}_a": getattr(job.inks[0], f"h{order}") for order in (1, 2, 3)}
    wires = {
        "controller": ("profiler", ("measured_height", "valid", "layers_scanned")),
        "printer": ("controller", ("pattern", "drop_level", "layer_command")),
        "profiler": ("printer", ("height", "layers_printed")),
    }
    values = {
        "controller": {
            "target_height": job.target_height,
            "mask": job.mask,
            "flat_ground": True,
            "horizon": 3,
            "seed": job.seed,
            "annealing_sweeps": ANNEALING_SWEEPS,
            **ink,
        },
        "printer": {"variation": 0.2, "layer_duration": 2.0, "seed": job.seed},
        "profiler": {"noise_std": 0.3e-6, "scan_duration": 6.0, "seed": job.seed},
    }
    models = ("LayerController", "LayerDeposition", "ProfileSensor")
    parts = {
        name: Driver(model, form, job.nx, job.ny).start(values[name])
        for name, model, form in zip(wires, models, forms, strict=True)
    }
    time = 0.0
    while parts["controller"].get("status") != Status.DONE:
        for name, (source, ports) in wires.items():
            assert max(parts[name].set(port, parts[source].get(port)) for port in ports) == OK
        assert parts["controller"].set("layers_printed", parts["printer"].get("layers_printed")) == OK
        before = parts["printer"].get("layers_printed")
        assert max(part.step(time, step) for part in parts.values()) == OK
        time += step
        if parts["printer"].get("layers_printed") != before:
            yield parts["printer"].get("height")
    for part in parts.values():
        part.fmu.freeInstance()


@pytest.mark.system
@pytest.mark.parametrize(
    ("forms", "step"),
    [
        (("fmi3", "fmi3", "fmi3"), 1.0),
        (("fmi2", "fmi2", "fmi2"), 0.7),
        (("fmi2", "fmi3", "fmi3-fixed"), 5.0),
    ],
)
def test_three_fmus_in_plain_fmpy_print_the_layers_of_our_master(forms: tuple[str, str, str], step: float) -> None:
    expected = printed().height[1:]
    np.testing.assert_array_equal(list(layers(forms, step)), expected)


@EVERY_FORM
def test_alpha_and_the_time_limit_can_be_tuned_between_steps_and_nothing_else(form: str) -> None:
    with Driver("LayerController", form, 8, 7).start({"layers_scanned": 0, "is_timed": False, "horizon": 3}) as fmu:
        saved = fmu.save()
        assert fmu.step(0.0) == OK
        assert fmu.set("horizon", 2) == ERROR
        heights = fmu.get("objective")
        assert fmu.restore(saved) == OK
        assert max(fmu.set("alpha", 0.5), fmu.set("time_limit", 10.0), fmu.step(0.0)) == OK
        assert fmu.get("objective") == pytest.approx(0.5 * fmu.get("objective_error"), rel=0.1, abs=0.0)
        assert fmu.get("objective") < 0.7 * heights


@EVERY_FORM
def test_plan_that_ran_out_of_time_is_still_one(form: str) -> None:
    with Driver("LayerController", form, 12, 12).start({"layers_scanned": 0, "time_limit": 1e-9}) as fmu:
        assert fmu.step(0.0) == OK
        assert (fmu.get("plan_status"), fmu.get("left_out")) == (5, 15)
        assert fmu.get("layer_command") == 1
        assert fmu.get("pattern").all()


@EVERY_FORM
def test_part_of_no_cell_is_refused_with_a_message(form: str) -> None:
    with Driver("LayerController", form) as fmu:
        assert max(fmu.set("mask", False), fmu.enter()) == OK
        assert fmu.exit() in (DISCARD, ERROR)
        if form != "fmi2":
            assert fmu.messages[-1].endswith("mask marks no cell; expected the cells of the part")
        assert max(fmu.set("mask", True), fmu.exit()) == OK


@EVERY_FORM
@pytest.mark.parametrize("high", ["measured_height", "target_height"])
def test_heights_beyond_the_search_are_refused_and_change_nothing(form: str, high: str) -> None:
    """One cell of the last row, by droplets that leave room for 0.34 m."""
    ink = {"h1_a": 1e-3, "h2_a": 7.5e-4, "h3_a": 0.0, "h1_b": 1e-3, "h2_b": 7.5e-4, "h3_b": 0.0}
    for height in (0.35, 0.33):
        map_ = np.zeros((3, 3))
        map_[2, 1] = height
        parameters = {**ink, "layers_scanned": 0, "horizon": 5, "drop_levels": 2, high: map_}
        with Driver("LayerController", form, 3, 3).start(parameters) as fmu:
            before = fmu.save()
            if height < 0.34:
                assert fmu.step(0.0) == OK
                continue
            assert fmu.step(0.0) in (DISCARD, ERROR)
            assert fmu.save() == before
            if form != "fmi2":
                assert "cell (2, 1) is estimated at" in fmu.messages[-1]


@EVERY_FORM
def test_first_scan_without_a_reading_is_refused_and_changes_nothing(form: str) -> None:
    with Driver("LayerController", form).start({"valid": False, "layers_scanned": 0}) as fmu:
        before = fmu.save()
        assert fmu.step(0.0) in (DISCARD, ERROR)
        assert fmu.save() == before
        if form != "fmi2":
            assert "scan 0, the first one, has readings on less than 2 %" in fmu.messages[-1]


TWO_INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def pipes(**fields: Any) -> Job:
    """A small junction of two pipes in a block: on some cells the first ink belongs at two intervals of height."""
    walls = PipeJunction(10 * 1e-4, 10 * 1e-4, 7e-4, 30e-6, 4e-4, 16e-6, 60e-6)
    job = block(20, 20, height=60e-6, inks=TWO_INKS, region=walls, **fields)
    return replace(job, pitch=1e-4)


def test_two_inks_on_a_grey_head_in_four_passes_are_those_of_the_python_controller() -> None:
    job, options = pipes(passes=4), {"drop_levels": 3, "adapt_ink": "full", "horizon": 1, "annealing_sweeps": 1}
    assert assert_same_print(*twins(job, options), job) > 3


def test_second_ink_without_a_region_is_never_jetted() -> None:
    job = block(inks=TWO_INKS)
    assert assert_same_print(*twins(job, {"annealing_sweeps": 5}), job) > 3


@EVERY_FORM
def test_more_kinds_of_droplets_than_the_search_takes_are_refused(form: str) -> None:
    with Driver("LayerController", form) as fmu:
        assert max(fmu.set("inks", 2), fmu.set("drop_levels", 9), fmu.enter()) == OK
        assert fmu.exit() in (DISCARD, ERROR)


def test_commands_count_from_the_layers_that_are_printed() -> None:
    job = block()
    controller = catalog.make("LayerController", job, {})
    assert controller.initialize(0, inputs_of(job, np.zeros((10, 9)), 41))["layer_command"] == 41
    outputs = controller.do_step(0, SECOND, inputs_of(job, np.zeros((10, 9)), 41))
    assert outputs["layer_command"] == 42
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

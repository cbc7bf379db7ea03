"""Changes by a master to the controller FMU between steps, and the same by options in Python: the layers agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Status
from inkloop.components import catalog
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND, block, inputs_of
from support.fmus.fmu_driver import EVERY_FORM, OK, Driver


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
    parameters = {"target_height": job.target_height, "mask": job.mask, "flat_ground": True, "is_timed": False, **work}
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

"""Whole prints of the shipped scenarios by the controller FMU and by the one in Python: the same layers, bit by bit."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.component import Status
from inkloop.components import catalog
from inkloop_controller.model.layer_model import LayerModel
from support import prints
from support.closed_loop import SECOND, block, inputs_of
from support.fmus.fmu_driver import EVERY_FORM, OK, Driver
from support.places import SCENARIOS

FOLDER = SCENARIOS
OF_PYTHON_ALONE = ["bound", "bound_confidence", "bound_valid", "gap", "solve_time"]
QUICK = ("tilted-substrate", "two-materials")
FIRST_LAYERS = ("pipe-junction", "surface-tension", "tilted-substrate", "two-materials")  # show as much


def planned_by_mpc(path: Path) -> bool:
    """The scenario's controller is LayerMpc, and nothing of it is a device."""
    tables = tomllib.loads(path.read_text(encoding="utf-8"))["components"]
    kinds = {name: table["kind"] for name, table in tables.items()}
    return kinds["controller"] == "LayerMpc" and not any(kind.startswith("hardware.") for kind in kinds.values())


OTHERS = [path.stem for path in sorted(FOLDER.glob("*.toml")) if planned_by_mpc(path) and path.stem not in QUICK]


def printed(name: str, *overrides: tuple[str, Any]) -> xr.Dataset:
    limit = [("run.layers_max", 6)] if name in FIRST_LAYERS else []
    dataset = prints.printed(name, ("seed", 1), *limit, *overrides).dataset
    return dataset.drop_vars([variable for variable in OF_PYTHON_ALONE if variable in dataset])


def assert_same_print(name: str, form: str) -> None:
    native = printed(name, ("components.controller", {"kind": "LayerController", "fmi": form}))
    xr.testing.assert_identical(native.drop_attrs(), printed(name).drop_attrs())


@pytest.mark.system
@pytest.mark.parametrize("name", QUICK)
def test_scenario_is_printed_alike(name: str) -> None:
    assert_same_print(name, "fmi3")


@pytest.mark.long
@pytest.mark.parametrize("form", ["fmi3", "fmi2"])
@pytest.mark.parametrize("name", OTHERS)
def test_every_scenario_is_printed_alike(name: str, form: str) -> None:
    assert_same_print(name, form)


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

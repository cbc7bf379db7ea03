"""The controller as an FMU is the one in Python: the same patterns over whole prints, bit by bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Ink, Job, Status
from inkloop.components import catalog
from inkloop.errors import ComponentError
from inkloop.geometry import PipeJunction
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import SECOND, block, cylinder, inputs_of, print_part
from support.fmus.fmu_driver import DISCARD, ERROR, EVERY_FORM, OK, Driver
from support.long_proofs import rest_is_long
from support.small_block import ANNEALING_SWEEPS, assert_same_layers, printed
from support.small_block import job as block_job

OF_PYTHON_ALONE = {"bound", "bound_confidence", "gap", "solve_time"}
Scan = Callable[[Any, int], Any]


def exact(height: Any, layer: int) -> Any:
    return height


def noisy(height: Any, layer: int) -> Any:
    """1 um of noise in steps of 0.1 um, a drifting and tilting frame."""
    i, _ = np.indices(height.shape)
    reading = height + np.random.default_rng(layer).normal(0.0, 1e-6, height.shape) + layer * (0.2e-6 + 0.01e-6 * i)
    return np.round(reading / 0.1e-6) * 0.1e-6


class Seen:
    """Scans with cells lost at random, for a controller that stands between them and the loop."""

    def __init__(self, controller: Component, share: float) -> None:
        self.inputs, self.outputs = controller.inputs, controller.outputs
        self._controller, self._share = controller, share

    def initialize(self, time_ns: int, inputs: Any) -> Any:
        return self._controller.initialize(time_ns, inputs)

    def do_step(self, time_ns: int, step_ns: int, inputs: Any) -> Any:
        lost = np.random.default_rng(int(inputs["layers_scanned"])).random(inputs["valid"].shape) < self._share
        return self._controller.do_step(time_ns, step_ns, {**inputs, "valid": ~lost})


def twins(job: Job, python: dict[str, Any], fmu: dict[str, Any] | None = None) -> tuple[Component, Component]:
    """The Python controller with options, and the FMU with the same ones, or with `fmu` where they are called else."""
    return catalog.make("LayerMpc", job, python), catalog.make("LayerController", job, python if fmu is None else fmu)


def assert_same_print(one: Component, other: Component, job: Job, scan: Scan = exact, **options: Any) -> int:
    """The number of layers of a print of 20 % variation, which must be the same by both."""
    first, second = (print_part(controller, job, variation=0.2, scan=scan, **options) for controller in (one, other))
    np.testing.assert_array_equal(first.patterns, second.patterns)
    for name in first.outputs.keys() - OF_PYTHON_ALONE:
        np.testing.assert_array_equal(first.outputs[name], second.outputs[name], err_msg=name)
    return len(first.patterns)


@pytest.mark.system
@pytest.mark.parametrize(
    ("height", "scan"),
    rest_is_long([(60e-6, noisy), (400e-6, noisy), (400e-6, exact)], 0),
)
def test_cylinder_is_the_one_of_the_python_controller(height: float, scan: Scan) -> None:
    job = cylinder(height)
    assert assert_same_print(*twins(job, {}), job, scan) > 0.15 * height / 1e-6


FEW_SWEEPS: dict[str, Any] = {"annealing_sweeps": 5}
LIMITS: dict[str, Any] = {
    **{"overshoot": 3.0, "overshoot_limit_um": 0.5, "chance_margin": 1.0, "fringe_weight": 0.3, "layer_worth": 0.01},
    **{"horizon": 3, "annealing_sweeps": 1, "droplet_std": 0.2},
}
CASES: dict[str, tuple[Job, dict[str, Any], dict[str, Any]]] = {
    "one layer ahead": (block(), {"horizon": 1}, {"horizon": 1}),
    "one layer ahead, height only": (block(), {"horizon": 1, "alpha": 1.0}, {"horizon": 1, "alpha": 1.0}),
    "two layers": (block(16, 15), {"horizon": 2, "alpha": 0.4}, {"horizon": 2, "alpha": 0.4}),
    "five layers": (block(8, 7, height=20e-6), {"horizon": 5}, {"horizon": 5}),
    "four passes": (
        block(12, 10, passes=4, pass_order=2, pass_rotation=1, seed=7),
        {"horizon": 2},
        {"horizon": 2},
    ),
    "other ink": (block(inks=(Ink(5e-6, 0.4e-6, 0.3e-6),)), FEW_SWEEPS, FEW_SWEEPS),
    "grey head": (block(12, 10), {"drop_levels": 3, "horizon": 2}, {"drop_levels": 3, "horizon": 2}),
    "three heights learnt": (
        block(14, 12),
        {"adapt_ink": "full", "horizon": 2},
        {"adapt_ink": "full", "horizon": 2},
    ),
    "nothing learnt": (block(), {"adapt_ink": "off", **FEW_SWEEPS}, {"adapt_ink": "off", **FEW_SWEEPS}),
    "little work": (
        block(14, 12),
        {"sweeps": 1, "annealing_sweeps": 0, "iterations": 3},
        {"sweeps_max": 1, "annealing_sweeps": 0, "iterations": 3},
    ),
    "limits": (
        block(14, 12),
        LIMITS,
        LIMITS,
    ),
    "few layers": (block(14, 12), {"finish": "fast", **FEW_SWEEPS}, {"finish": "fast", **FEW_SWEEPS}),
    "known sensor": (
        block(),
        {"sensor_noise_std_um": 1.0, "sensor_resolution_um": 0.1, **FEW_SWEEPS},
        {"sensor_noise_std_um": 1.0, "sensor_resolution_um": 0.1, **FEW_SWEEPS},
    ),
}


@pytest.mark.system
@pytest.mark.parametrize("scan", rest_is_long([noisy, exact], 1))
@pytest.mark.parametrize("case", rest_is_long(CASES, len(CASES) - 2))
def test_print_is_the_one_of_the_python_controller(case: str, scan: Scan) -> None:
    job, python, fmu = CASES[case]
    assert assert_same_print(*twins(job, python, fmu), job, scan) >= 3


def test_cells_that_were_not_seen_are_predicted_alike() -> None:
    job, options = block(18, 16, height=60e-6), {"untrusted_layers": 0, "horizon": 2, "annealing_sweeps": 1}
    one, other = list[Any](Seen(controller, 0.3) for controller in twins(job, options))
    assert assert_same_print(one, other, job, noisy) > 6


def test_dead_cells_are_found_and_left_out_alike() -> None:
    job, plant = block(24, 22, height=100e-6), LayerModel.of(block(24, 22, height=100e-6))
    controllers = twins(job, {"horizon": 2, "annealing_sweeps": 1})
    height, dead = np.zeros((24, 22)), 0
    for controller in controllers:
        controller.initialize(0, inputs_of(job, height, 0))
    for layer in range(40):
        one, other = (
            controller.do_step(layer * SECOND, SECOND, inputs_of(job, height, layer)) for controller in controllers
        )
        for name in one.keys() - OF_PYTHON_ALONE:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        dead = max(dead, int(other["dead_cells"]))
        if other["status"] == Status.DONE:
            break
        factor = np.where(np.arange(22) == 9, 1e-12, 1.0) * np.ones((24, 22))
        height = plant.layer(height, np.asarray(other["pattern"]), layer + 1, factor)
    assert dead > 0


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


def low_wall(height: Any, layer: int) -> Any:
    """A frame that is 25 um too high, and a wall of which the profiler reads the half."""
    reading = height + 25e-6
    reading[5] = 25e-6 + 0.5 * height[5]
    return reading


def test_ground_that_is_not_flat_and_cells_that_do_not_answer_are_reported_alike() -> None:
    mask = np.pad(np.ones((10, 8), np.bool_), 5)
    job = Job(20, 18, 263.256e-6, np.where(mask, 30e-6, 0.0), mask)
    options = {"horizon": 2, "annealing_sweeps": 1, "register_scans": False, "volume_least": 0.95}
    controllers, height, plant = twins(job, options), np.zeros((20, 18)), LayerModel.of(job)
    reasons = set()
    for controller in controllers:
        controller.initialize(0, inputs_of(job, low_wall(height, 0), 0))
    for layer in range(14):
        inputs = inputs_of(job, low_wall(height, layer), layer)
        one, other = (controller.do_step(layer * SECOND, SECOND, inputs) for controller in controllers)
        for name in one.keys() - OF_PYTHON_ALONE:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        assert other["status"] in (Status.DONE, Status.UNTRUSTED)
        reasons.add(int(other["untrusted_reasons"]))
        height = plant.layer(height, np.asarray(other["pattern"]), layer + 1)
    assert 4 in reasons
    assert any(each & 16 for each in reasons)
    assert other["ground_offset"] == pytest.approx(25e-6, abs=1e-9)


@pytest.mark.parametrize("unknown", [1, 3])
@pytest.mark.parametrize("scan", [exact, noisy])
def test_layer_that_was_given_up_midway_is_judged_alike(unknown: int, scan: Scan) -> None:
    job, plant = block(14, 12), LayerModel.of(block(14, 12))
    controllers, height = twins(job, {"horizon": 2, "annealing_sweeps": 1}), np.zeros((14, 12))
    for controller in controllers:
        controller.initialize(0, inputs_of(job, height, 0))
    for layer in range(5):
        inputs = inputs_of(job, scan(height, layer), layer) | {"layer_unknown": np.asarray(layer == unknown)}
        one, other = (controller.do_step(layer * SECOND, SECOND, inputs) for controller in controllers)
        for name in one.keys() - OF_PYTHON_ALONE:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
        jetted = np.where(np.arange(14)[:, None] < (7 if layer + 1 == unknown else 14), other["pattern"], 0)
        height = plant.layer(height, jetted.astype(np.int32), layer + 1)


@EVERY_FORM
def test_every_form_prints_the_same_layers_in_our_master(form: str) -> None:
    assert_same_layers(printed(controller=("LayerController", {"fmi": form})), printed())


def test_nozzles_known_to_be_dead_are_spared_alike() -> None:
    job, alive = block(14, 12), np.ones((14, 12), np.bool_)
    alive[:, [3, 7]] = False
    work = {"annealing_sweeps": 1}
    one, other = twins(job, {"dead_nozzles": [3, 7], **work}, {"jettable": alive.tolist(), **work})
    assert assert_same_print(one, other, job) > 3


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


TWO_INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def pipes(**fields: Any) -> Job:
    """A small junction of two pipes in a block: on some cells the first ink belongs at two intervals of height."""
    walls = PipeJunction(10 * 1e-4, 10 * 1e-4, 7e-4, 30e-6, 4e-4, 16e-6, 60e-6)
    job = block(20, 20, height=60e-6, inks=TWO_INKS, region=walls, **fields)
    return replace(job, pitch=1e-4)


@pytest.mark.system
@pytest.mark.parametrize("test", rest_is_long(["middle", "surface", "either"], 1))
def test_two_inks_in_their_regions_are_those_of_the_python_controller(test: str) -> None:
    job = pipes()
    assert assert_same_print(*twins(job, {"region_test": test, "horizon": 2, "annealing_sweeps": 1}), job, noisy) > 6


def test_two_inks_on_a_grey_head_in_four_passes_are_those_of_the_python_controller() -> None:
    job, options = pipes(passes=4), {"drop_levels": 3, "adapt_ink": "full", "horizon": 1, "annealing_sweeps": 1}
    assert assert_same_print(*twins(job, options), job) > 3


def test_second_ink_without_a_region_is_never_jetted() -> None:
    job = block(inks=TWO_INKS)
    assert assert_same_print(*twins(job, FEW_SWEEPS), job) > 3


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

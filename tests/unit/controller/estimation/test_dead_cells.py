"""Cells whose droplets do not come: found when they die, not before, and taken back when they jet again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job, Status
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.model import LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from support.closed_loop import SECOND, block, cylinder, inputs_of
from support.long_proofs import rest_is_long

LINE = 16
NOTHING = 1e-12  # volume of the droplets of a dead nozzle [1]
FOUND_WITHIN = 4  # layers


@dataclass(frozen=True)
class Print:
    """dead_cells by layer, false alarms (layers times cells), the surface [m], the layers it took, and how it ended."""

    dead_cells: list[int]
    false_alarms: int
    height: Any
    layers: int
    stop: int


def printed(
    job: Job,
    seed: int,
    variation: float,
    noise: float,
    dead: range,
    volume: float = NOTHING,
    line: Any = LINE,
    **options: Any,
) -> Print:
    """A print by a controller with `options` in which the nozzles of `line` jet droplets of `volume` in the layers
    `dead`."""
    controller, plant = LayerMpcController(job, **{"horizon": 2, **options}), LayerModel.of(job)
    droplets, sensor = np.random.default_rng(seed), np.random.default_rng(seed + 1000)
    height, dead_cells, false_alarms = np.zeros((job.nx, job.ny)), [], 0

    def scan() -> Any:
        return height + noise * sensor.standard_normal(height.shape)

    controller.initialize(0, inputs_of(job, scan(), 0))
    for layer in range(200):
        outputs = controller.do_step(layer * SECOND, SECOND, inputs_of(job, scan(), layer))
        found, stop = int(outputs["dead_cells"]), int(outputs["stop_reason"])
        dead_cells.append(found)
        false_alarms += 0 if layer in dead else found
        if outputs["status"] == Status.DONE or stop:
            return Print(dead_cells, false_alarms, height, layer, stop)
        factor = 1.0 - variation * droplets.random(height.shape)
        if layer + 1 in dead:
            factor[:, line] = volume
        height = plant.layer(height, outputs["pattern"], layer + 1, factor)
    raise AssertionError("not done after 200 layers")


@pytest.mark.system
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_print_with_a_nozzle_that_dies_unreported_comes_to_its_end(noise: float) -> None:
    job = cylinder()
    found = printed(job, 1, 0.2, noise, range(10, 999))
    line = int(job.mask[:, LINE].sum())
    assert not found.stop
    assert found.dead_cells[9] == 0
    assert found.dead_cells[18] == pytest.approx(line, abs=2)
    assert found.dead_cells[-1] == line
    away = job.mask.copy()
    away[:, LINE - 1 : LINE + 2] = False
    assert np.abs((job.target_height - found.height)[away]).mean() < 0.8e-6


@pytest.mark.system
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_nozzle_that_is_cleaned_is_noticed_and_its_line_filled(noise: float) -> None:
    job = cylinder()
    found = printed(job, 2, 0.2, noise, range(10, 30))
    assert not found.stop
    assert max(found.dead_cells[15:30]) == int(job.mask[:, LINE].sum())
    assert not any(found.dead_cells[36:])
    assert np.abs((job.target_height - found.height)[job.mask]).mean() < 0.8e-6


@pytest.mark.system
@pytest.mark.parametrize("seed", rest_is_long(range(10), 2))
def test_droplets_that_vary_and_scans_that_are_noisy_are_no_dead_nozzles(seed: int) -> None:
    assert printed(cylinder(), seed, 0.4, 1e-6, range(0)).false_alarms == 0


@pytest.mark.system
def test_widths_that_noise_makes_unsure_are_no_dead_nozzles() -> None:
    assert printed(cylinder(), 1, 0.4, 1e-6, range(0), adapt_ink="full").false_alarms == 0


@pytest.mark.system
def test_nozzle_that_brings_a_third_of_its_ink_is_weak_and_not_dead() -> None:
    assert not any(printed(cylinder(), 3, 0.2, 0.0, range(10, 200), volume=1.0 / 3.0).dead_cells)


def deaths(
    dead: dict[tuple[int, int], Any], layers: int, noise: float = 0.1e-6, **options: Any
) -> tuple[list[Estimate], list[Any]]:
    """Estimates and surfaces after full layers but for one bare cell; by cell, the layers in which its droplets do not
    come."""
    job, seen, rng = block(20, 20), np.ones((20, 20), np.bool_), np.random.default_rng(1)
    plant, estimator = LayerModel.of(job), HeightEstimator(job, sensor_noise_std=noise, **options)
    pattern, surfaces = job.mask.astype(np.int32), [np.zeros(seen.shape)]
    pattern[5, 5] = 0
    found = [estimator.first(surfaces[0], seen)]
    for layer in range(1, layers + 1):
        factor = np.ones(seen.shape)
        for cell, when in dead.items():
            factor[cell] = NOTHING if layer in when else 1.0
        surfaces.append(plant.layer(surfaces[-1], pattern, layer, factor))
        scan = surfaces[-1] + noise * rng.standard_normal(seen.shape)
        found.append(estimator.next(found[-1], pattern, layer, scan, seen))
    return found, surfaces


@pytest.mark.parametrize("noise", [0.0, 0.1e-6, 0.3e-6])
def test_dead_cell_is_found_after_three_or_four_layers_and_taken_back_after_one_that_came(noise: float) -> None:
    dead = (10, 10)
    found, _ = deaths({dead: range(1, 6)}, 6, noise)
    shown = [bool(each.dead[dead]) for each in found]
    assert shown[:3] == [False] * 3
    assert shown[FOUND_WITHIN:] == [True, True, False]
    assert not any(np.delete(each.dead.ravel(), 10 * 20 + 10).any() for each in found)


@pytest.mark.parametrize("options", [{}, {"register_scans": False}])
def test_nozzle_that_jetted_well_for_long_is_found_as_soon_as_one_that_never_did(options: dict[str, Any]) -> None:
    late, early = (10, 10), (14, 5)
    estimates, _ = deaths({late: range(11, 99), early: range(1, 99)}, 16, **options)
    found = {cell: [bool(each.dead[cell]) for each in estimates].index(True) for cell in (late, early)}
    assert found[early] <= FOUND_WITHIN
    assert found[late] - 10 <= FOUND_WITHIN


@pytest.mark.parametrize("width", [16, 6])
def test_layer_without_any_ink_says_nothing_about_nozzles(width: int) -> None:
    """Whatever share of the grid the part has."""
    job, seen = block(20, 20), np.ones((20, 20), np.bool_)
    job.mask[:, 2 + width :] = False
    plant, estimator = LayerModel.of(job), HeightEstimator(job, sensor_noise_std=0.1e-6)
    pattern, dead, surface = job.mask.astype(np.int32), (10, 5), np.zeros(seen.shape)
    estimate = estimator.first(surface, seen)
    for layer in (1, 2):
        factor = np.ones(seen.shape)
        factor[dead] = NOTHING
        surface = plant.layer(surface, pattern, layer, factor)
        estimate = estimator.next(estimate, pattern, layer, surface, seen)
    before = estimate.state["dead_evidence"].copy()
    assert before[dead] > 0.0
    surface = plant.layer(surface, pattern, 3, np.full(seen.shape, NOTHING))
    after = estimator.next(estimate, pattern, 3, surface, seen)
    np.testing.assert_array_equal(after.state["dead_evidence"], before)


def test_dead_cells_are_left_out_of_the_plan_and_tried_in_every_fifth_layer() -> None:
    job = block()
    dead = np.zeros((job.nx, job.ny), np.bool_)
    dead[4, 4] = True
    estimate = replace(Estimate.exact(np.zeros(dead.shape), job.inks), dead=dead)
    mpc = LayerMpc(job, horizon=3)
    for layer in range(1, 16):
        choices = mpc.problem(estimate, layer - 1).choices
        assert choices[:, 4, 4].tolist() == [int(layer % 5 == 0), 0, 0]
        assert choices[:, 4, 5].all()

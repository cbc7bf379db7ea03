"""Cells whose droplets do not come: found when they die, not before, and taken back when they jet again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job, Status
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import DEAD_EVIDENCE, Estimate, HeightEstimator
from inkloop_controller.model.layer_model import LayerModel
from inkloop_controller.planning.layer_mpc import LayerMpc
from support.closed_loop import SECOND, block, cylinder, inputs_of
from support.long_proofs import rest_is_long

LINE = 16
NOTHING = 1e-12  # volume of the droplets of a dead nozzle [1]


@dataclass(frozen=True)
class Print:
    """dead_cells by layer, false alarms (layers times cells), the surface [m] and the layers it took."""

    dead_cells: list[int]
    false_alarms: int
    height: Any
    layers: int


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
        found = int(outputs["dead_cells"])
        dead_cells.append(found)
        false_alarms += 0 if layer in dead else found
        if outputs["status"] == Status.DONE:
            return Print(dead_cells, false_alarms, height, layer)
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
    assert found.dead_cells[9] == 0
    assert found.dead_cells[20] == pytest.approx(line, abs=2)
    assert found.dead_cells[-1] == line
    away = job.mask.copy()
    away[:, LINE - 1 : LINE + 2] = False
    assert np.abs((job.target_height - found.height)[away]).mean() < 0.8e-6


@pytest.mark.system
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_nozzle_that_is_cleaned_is_noticed_and_its_line_filled(noise: float) -> None:
    job = cylinder()
    found = printed(job, 2, 0.2, noise, range(10, 30))
    assert max(found.dead_cells[15:30]) == int(job.mask[:, LINE].sum())
    assert not any(found.dead_cells[36:])
    assert np.abs((job.target_height - found.height)[job.mask]).mean() < 0.8e-6


@pytest.mark.system
@pytest.mark.parametrize("seed", rest_is_long(range(10), 2))
def test_droplets_that_vary_and_scans_that_are_noisy_are_no_dead_nozzles(seed: int) -> None:
    assert printed(cylinder(), seed, 0.4, 1e-6, range(0)).false_alarms == 0


@pytest.mark.system
def test_widths_that_noise_makes_unsure_are_no_dead_nozzles() -> None:
    """With the learnt proportions of h1, h2 and h3 cells were taken for dead here."""
    assert printed(cylinder(), 1, 0.4, 1e-6, range(0), adapt_ink="full").false_alarms == 0


@pytest.mark.system
def test_nozzle_that_brings_a_third_of_its_ink_is_weak_and_not_dead() -> None:
    assert not any(printed(cylinder(), 3, 0.2, 0.0, range(10, 200), volume=1.0 / 3.0).dead_cells)


def test_one_layer_is_not_enough_and_cells_without_a_command_give_no_information() -> None:
    job, seen = block(20, 20), np.ones((20, 20), np.bool_)
    plant, estimator = LayerModel.of(job), HeightEstimator(job, sensor_noise_std=0.1e-6)
    pattern, dead = job.mask.astype(np.int32), (10, 10)
    pattern[5, 5] = 0
    surface, evidence = np.zeros(seen.shape), []
    estimate = estimator.first(surface, seen)
    for layer, volume in enumerate([NOTHING] * 5 + [1.0], start=1):
        factor = np.ones(seen.shape)
        factor[dead] = volume
        surface = plant.layer(surface, pattern, layer, factor)
        estimate = estimator.next(estimate, pattern, layer, surface, seen)
        evidence.append(estimate.dead_evidence[dead])
        assert np.argwhere(estimate.dead_evidence > 0.0).tolist() == [list(dead)]
    assert 0.0 < evidence[0] < DEAD_EVIDENCE
    assert evidence[4] == DEAD_EVIDENCE
    assert evidence[5] < DEAD_EVIDENCE


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
    before = estimate.dead_evidence.copy()
    assert before[dead] > 0.0
    surface = plant.layer(surface, pattern, 3, np.full(seen.shape, NOTHING))
    np.testing.assert_array_equal(estimator.next(estimate, pattern, 3, surface, seen).dead_evidence, before)


def test_nozzle_that_jetted_well_for_long_is_found_as_soon_as_one_that_never_did() -> None:
    job, seen = block(20, 20), np.ones((20, 20), np.bool_)
    plant, estimator = LayerModel.of(job), HeightEstimator(job, sensor_noise_std=0.1e-6)
    pattern, late, early = job.mask.astype(np.int32), (10, 10), (5, 5)
    surface, found = np.zeros(seen.shape), dict[tuple[int, int], int]()
    estimate = estimator.first(surface, seen)
    for layer in range(1, 17):
        factor = np.ones(seen.shape)
        factor[early] = NOTHING
        if layer > 10:
            factor[late] = NOTHING
        surface = plant.layer(surface, pattern, layer, factor)
        estimate = estimator.next(estimate, pattern, layer, surface, seen)
        found |= {cell: layer for cell in (late, early) if estimate.dead[cell] and cell not in found}
    assert found[late] == 10 + found[early]


def test_ink_that_runs_out_is_no_dead_nozzle_and_the_print_continues_when_it_is_back() -> None:
    job = cylinder()
    found = printed(job, 4, 0.2, 0.0, range(10, 20), line=slice(None))
    assert not any(found.dead_cells)
    assert np.abs((job.target_height - found.height)[job.mask]).mean() < 0.8e-6


def test_dead_cells_are_left_out_of_the_plan_and_tried_in_every_fifth_layer() -> None:
    job = block()
    evidence = np.zeros((job.nx, job.ny))
    evidence[4, 4] = DEAD_EVIDENCE
    estimate = Estimate(**{**vars(Estimate.exact(np.zeros(evidence.shape), job.inks)), "dead_evidence": evidence})
    mpc = LayerMpc(job, horizon=3)
    for layer in range(1, 11):
        choices = mpc.problem(estimate, layer - 1).choices
        assert choices[:, 4, 4].tolist() == [int(layer % 5 == 0), 0, 0]
        assert choices[:, 4, 5].all()


def test_ink_that_never_came_is_forgotten_up_to_the_ends_of_a_line_that_jets_again() -> None:
    """Here the last two cells at both ends touch the outside; no scan can show a displaced wall."""
    job, column = cylinder(), 5
    plant, estimator = LayerModel.of(job), HeightEstimator(job, sensor_noise_std=0.1e-6)
    pattern, seen, line = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_), job.mask[:, column]
    assert job.mask[np.ix_([8, 9], [4, 5])].tolist() == [[False, True], [False, True]]
    surface = np.zeros(seen.shape)
    estimate = estimator.first(surface, seen)
    for layer, volume in enumerate([NOTHING] * 5 + [1.0], start=1):
        factor = np.ones(seen.shape)
        factor[:, column] = volume
        surface = plant.layer(surface, pattern, layer, factor)
        estimate = estimator.next(estimate, pattern, layer, surface, seen)
        assert estimate.dead[line, column].all() == (3 <= layer <= 5)
    np.testing.assert_array_equal(estimate.reckoned[line, column], estimate.height[line, column])

"""Cells that ask for ink and do not answer: capped where an open loop would stand, whatever scans show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Status
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.estimation.loop_trust import UntrustedReason
from inkloop_controller.planning.layer_mpc import LayerMpc
from support.closed_loop import SECOND, block, inputs_of
from support.long_proofs import rest_is_long
from support.numpy import lu_numpy

LAYER, DROPLET = 7.6e-6, 0.1 * np.sqrt(4.4**2 + 4 * 0.6**2 + 4 * 0.2**2) * 1e-6
JOB = block(14, 13, height=30e-6)
SEEN = np.ones((JOB.nx, JOB.ny), np.bool_)
OUTSIDE = (3, 4)  # cell of the part that the profiler reads as if it were outside


def limit(target: float) -> float:
    """What full nominal layers and one more build, and five standard deviations of so many droplets [m]."""
    layers = np.ceil(target / LAYER)
    return float((layers + 1.0) * LAYER + 5.0 * DROPLET * np.sqrt(layers))


def estimates(layers: int) -> list[tuple[Estimate, Any]]:
    """After full nominal layers of which one cell shows nothing; with what they build by NumPy alone."""
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    pattern, height = JOB.mask.astype(np.int32), np.zeros(SEEN.shape)
    found = [(estimator.first(height, SEEN), height)]
    for layer in range(1, layers + 1):
        height = lu_numpy.one_pass(height, pattern)[0]
        scan = height.copy()
        scan[OUTSIDE] = 0.0
        found.append((estimator.next(found[-1][0], pattern, layer, scan, SEEN), height))
    return found


def test_reckoning_is_the_layer_map_of_all_droplets_and_no_scan() -> None:
    for estimate, height in estimates(6):
        np.testing.assert_allclose(estimate.reckoned, height, rtol=0.0, atol=1e-15)


def test_cell_that_does_not_answer_is_capped_as_soon_as_its_next_droplet_would_pass_the_limit() -> None:
    counts = []
    for estimate, height in estimates(7):
        expected = np.zeros(SEEN.shape, np.bool_)
        expected[OUTSIDE] = height[OUTSIDE] + 4.4e-6 > limit(30e-6)
        np.testing.assert_array_equal(estimate.capped, expected)
        assert bool(estimate.trust.reasons & UntrustedReason.INK) is bool(expected.any())
        assert not LayerMpc(JOB, horizon=2).problem(estimate, 0).choices[:, estimate.capped].any()
        counts.append(int(expected.sum()))
    assert estimate.trust.excess_cell == OUTSIDE[0] * JOB.ny + OUTSIDE[1]
    assert estimate.trust.excess == pytest.approx(height[OUTSIDE], rel=1e-9, abs=0.0)
    assert counts[:5] == [0] * 5
    assert counts[-1] == 1


@pytest.mark.parametrize("drops", [1, 3])
def test_neighbours_of_a_cell_higher_than_droplets_explain_are_capped(drops: int) -> None:
    """In layers of the largest droplets."""
    estimator = HeightEstimator(JOB, drop_levels=drops, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    for rise, expected in ((0.8 * LAYER, 0), (1.0 * LAYER, 6)):
        surface = np.zeros(SEEN.shape)
        surface[2, 6] = 30e-6 + drops * rise  # at the edge of the part: six of the nine cells belong to it
        assert np.count_nonzero(estimator.first(surface, SEEN).capped) == expected
        controller = LayerMpcController(JOB, drop_levels=drops, horizon=1, annealing_sweeps=0, register_scans=False)
        controller.initialize(0, inputs_of(JOB, surface, 0))
        assert controller.do_step(0, SECOND, inputs_of(JOB, surface, 0))["capped_cells"] == expected


def test_cell_higher_than_its_target_is_a_reason_before_any_is_capped() -> None:
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    for rise, expected in ((0.35, UntrustedReason(0)), (0.45, UntrustedReason.HIGH)):
        surface = np.zeros(SEEN.shape)
        surface[2, 6], surface[0, 0] = 30e-6 + rise * LAYER, 60e-6  # the latter lies outside the part
        estimate = estimator.first(surface, SEEN)
        assert estimate.trust.reasons & UntrustedReason.HIGH == expected
        assert estimate.trust.high_cells == (expected > 0)
        assert not estimate.capped.any()


def test_foot_of_a_wall_that_droplets_of_the_wall_reach_is_trusted() -> None:
    """As in a bracket, whose plate is lower than its rib."""
    low = replace(
        JOB, target_height=np.where(np.arange(JOB.ny) < 6, np.minimum(JOB.target_height, 8e-6), JOB.target_height)
    )
    estimator = HeightEstimator(low, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    wall = (JOB.mask & (np.arange(JOB.ny) >= 6)).astype(np.int32)
    height = np.zeros(SEEN.shape)
    estimate = estimator.first(height, SEEN)
    for layer in range(1, 9):
        pattern = JOB.mask.astype(np.int32) if layer == 1 else wall
        height = lu_numpy.one_pass(height, pattern)[0]
        estimate = estimator.next(estimate, pattern, layer, height, SEEN)
    assert (height - low.target_height)[low.mask].max() > 0.6 * LAYER
    assert not estimate.trust.reasons
    higher = height + np.where(np.arange(JOB.ny) == 5, 0.6 * LAYER, 0.0)
    estimate = estimator.next(estimate, np.zeros_like(wall), 9, higher, SEEN)
    assert estimate.trust.reasons == UntrustedReason.HIGH


def test_ground_higher_than_the_target_caps_nothing_where_it_is_not_called_flat() -> None:
    estimator = HeightEstimator(JOB, flat_ground=False)
    surface = np.zeros(SEEN.shape)
    surface[2, 6] = 60e-6
    estimate = estimator.first(surface, SEEN)
    assert not estimate.capped.any()
    assert not estimate.trust.reasons


@pytest.mark.system
@pytest.mark.parametrize("share", rest_is_long([0.4, 0.8], 1))
def test_profiler_that_reads_a_wall_low_raises_no_cell_above_the_limit(share: float) -> None:
    """Droplets of the nominal volume at most: what stands there is what was reckoned."""
    job = block(14, 13, height=60e-6)
    low = np.zeros(SEEN.shape, np.bool_)
    low[2, 2:-2] = True
    controller = LayerMpcController(job, annealing_sweeps=1, register_scans=False)
    height, rng = np.zeros(SEEN.shape), np.random.default_rng(5)
    controller.initialize(0, inputs_of(job, height, 0))
    statuses = []
    for layer in range(60):
        scan = np.where(low, share * height, height)
        outputs = controller.do_step(layer * SECOND, SECOND, inputs_of(job, scan, layer))
        statuses.append(int(outputs["status"]))
        if statuses[-1] == Status.DONE:
            break
        factor = 1.0 - 0.1 * rng.random(height.shape)
        height = lu_numpy.one_pass(height, np.asarray(outputs["pattern"]), factor=factor)[0]
    assert statuses[-1] == Status.DONE
    assert Status.UNTRUSTED in statuses
    assert height.max() < limit(60e-6) + 1e-6  # what chance adds to the droplets of a cell beyond their mean volume

"""Cells that ask for ink and do not answer: capped by what their droplets bring at least, whatever scans show."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Status
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.planning.layer_mpc import LayerMpc
from support.closed_loop import SECOND, block, inputs_of
from support.long_proofs import rest_is_long
from support.numpy import lu_numpy

LAYER = 7.6e-6
TARGET = 30e-6
LEAST = 0.5  # volume that is believed, as a share of the nominal one
JOB = block(14, 13, height=TARGET)
SEEN = np.ones((JOB.nx, JOB.ny), np.bool_)
OUTSIDE = (3, 4)  # cell of the part that the profiler reads as if it were outside


def is_limit_passed(ledger: Any, least: float = LEAST) -> Any:
    """Cells where droplets of the least volume have built more than the target and one more layer."""
    return least * ledger > TARGET + LAYER


def estimates(layers: int, **options: Any) -> list[tuple[Estimate, Any]]:
    """After full nominal layers of which one cell shows nothing; with what they build by NumPy alone."""
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False, **options)
    pattern, height = JOB.mask.astype(np.int32), np.zeros(SEEN.shape)
    found = [(estimator.first(height, SEEN), height)]
    for layer in range(1, layers + 1):
        height = lu_numpy.one_pass(height, pattern)[0]
        scan = height.copy()
        scan[OUTSIDE] = 0.0
        found.append((estimator.next(found[-1][0], pattern, layer, scan, SEEN), height))
    return found


def test_ledger_is_the_layer_map_of_all_droplets_but_those_of_dead_nozzles_and_of_no_scan() -> None:
    full = found = np.zeros(SEEN.shape)
    for estimate, height in estimates(8):
        found = estimate.state["ledger"]
        if not estimate.dead.any():
            np.testing.assert_allclose(found, height, rtol=0.0, atol=1e-15)
        full = height
    assert estimate.dead.any()
    assert found[OUTSIDE] < full[OUTSIDE] - 3e-6
    np.testing.assert_allclose(found[OUTSIDE[0] + 4 :], full[OUTSIDE[0] + 4 :], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("least", [LEAST, 0.9])
def test_cells_are_capped_from_where_the_least_droplets_would_build_more_than_a_layer_too_much(least: float) -> None:
    for estimate, _ in estimates(14, volume_least=least):
        expected = JOB.mask & is_limit_passed(estimate.state["ledger"], least)
        np.testing.assert_array_equal(estimate.capped, expected)
        assert estimate.figures.capped_cells == expected.sum()
        assert bool(estimate.figures.reasons & UntrustedReason.INK) is bool(expected.any())
        assert not LayerMpc(JOB, horizon=2).problem(estimate, 0).choices[:, estimate.capped].any()
    assert expected.any()


@pytest.mark.parametrize("layer", [0, 1])
def test_cell_higher_than_its_target_is_a_reason_and_none_is_capped(layer: int) -> None:
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False, flat_ground=False)
    for rise, expected in ((0.35, UntrustedReason(0)), (0.45, UntrustedReason.HIGH)):
        surface = np.where(JOB.mask, 15e-6, 0.0)
        seen = surface.copy()
        seen[2, 6], seen[0, 0] = TARGET + rise * LAYER, 60e-6  # the latter lies outside the part
        estimate = estimator.first(surface, SEEN, 1)
        for _ in range(3):
            estimate = estimator.next(estimate, np.zeros(SEEN.shape, np.int32), 2, seen, SEEN)
        assert estimate.figures.reasons & UntrustedReason.HIGH == expected
        assert not estimate.capped.any()
        if expected:
            assert estimate.figures.rise_cell == 2 * JOB.ny + 6
            assert estimate.figures.rise == pytest.approx(rise * LAYER, rel=1e-2, abs=0.0)


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
    assert not estimate.figures.reasons & UntrustedReason.HIGH


STARTS = "half of the height of the start surface counts as what droplets have brought at least"


@pytest.mark.parametrize("height", [60e-6, pytest.param(90e-6, marks=pytest.mark.xfail(strict=True, reason=STARTS))])
def test_ground_higher_than_the_target_caps_nothing_before_ink_has_come(height: float) -> None:
    estimator = HeightEstimator(JOB, flat_ground=False)
    surface = np.zeros(SEEN.shape)
    surface[2, 6] = height
    estimate = estimator.first(surface, SEEN)
    assert not estimate.capped.any()
    assert not estimate.figures.reasons


@pytest.mark.xfail(strict=True, reason=STARTS)
def test_ink_on_a_high_start_surface_is_capped_as_on_flat_ground() -> None:
    """From the same height below the target on, by the same droplets."""
    caps = []
    for base in (0.0, 100e-6):
        job = replace(JOB, target_height=np.where(JOB.mask, TARGET + base, 0.0))
        estimator = HeightEstimator(job, adapt_ink="off", sensor_noise_std=0.0, register_scans=False, flat_ground=False)
        height, pattern = np.where(JOB.mask, base, 0.0), JOB.mask.astype(np.int32)
        estimate = estimator.first(height, SEEN, 1)
        for layer in range(2, 16):
            height = lu_numpy.one_pass(height, pattern)[0]
            estimate = estimator.next(estimate, pattern, layer, height, SEEN)
            if estimate.capped[5:8, 5:8].all():
                break
        caps.append(layer)
    assert caps[0] == caps[1]


@pytest.mark.system
@pytest.mark.parametrize("share", rest_is_long([0.4, 0.8], 1))
def test_profiler_that_reads_a_wall_low_raises_no_cell_above_the_limit(share: float) -> None:
    job = block(14, 13, height=60e-6)
    low = np.zeros(SEEN.shape, np.bool_)
    low[2, 2:-2] = True
    controller = LayerMpcController(job, annealing_sweeps=1, register_scans=False, volume_least=0.9)
    height, rng = np.zeros(SEEN.shape), np.random.default_rng(5)
    controller.initialize(0, inputs_of(job, height, 0))
    statuses = []
    for layer in range(60):
        scan = np.where(low, share * height, height)
        outputs = controller.do_step(layer * SECOND, SECOND, inputs_of(job, scan, layer))
        statuses.append(int(outputs["status"]))
        if statuses[-1] == Status.DONE or outputs["stop_reason"]:
            break
        factor = 1.0 - 0.1 * rng.random(height.shape)
        height = lu_numpy.one_pass(height, np.asarray(outputs["pattern"]), factor=factor)[0]
    assert statuses[-1] == Status.DONE or outputs["stop_reason"]
    assert Status.UNTRUSTED in statuses
    assert height.max() < (60e-6 + LAYER) / 0.9 + LAYER

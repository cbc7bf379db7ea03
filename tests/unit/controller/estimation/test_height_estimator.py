"""The estimated surface: what a scan is worth against what was expected."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.estimation.ink_identification import InkModel, ink_table
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import block, cylinder
from support.numpy import estimator_numpy, lu_numpy


def printed(job: Job, estimator: HeightEstimator, layers: int, noise_std: float, common: float = 0.0) -> Any:
    """(estimate, surface, last scan) after full layers of varying droplets; `common`: share of the noise in a scan."""
    rng, plant = np.random.default_rng(1), LayerModel.of(job)
    seen, pattern = np.ones(job.mask.shape, np.bool_), job.mask.astype(np.int32)
    height = np.zeros(job.mask.shape)

    def scan() -> Any:
        shared, own = rng.standard_normal(), rng.standard_normal(height.shape)
        return height + noise_std * (np.sqrt(common) * shared + np.sqrt(1.0 - common) * own)

    estimate, measured = estimator.first(scan(), seen), height
    for layer in range(1, layers + 1):
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(height.shape))
        measured = scan()
        estimate = estimator.next(estimate, pattern, layer, measured, seen)
    return estimate, height, measured


def rms(values: Any) -> float:
    return float(np.sqrt(np.mean(values**2)))


@pytest.mark.parametrize("common", [0.0, 0.5])
def test_estimate_is_nearer_to_the_surface_than_the_scan(common: float) -> None:
    job = cylinder()
    estimate, height, scan = printed(job, HeightEstimator(job), 15, 1e-6, common)
    error = (estimate.height - height)[job.mask]
    assert np.std(error) < 0.75 * np.std((scan - height)[job.mask])


def test_variance_measures_how_far_off_the_estimate_is() -> None:
    job = cylinder()
    estimate, height, _ = printed(job, HeightEstimator(job), 15, 1e-6)
    claimed = float(np.sqrt(estimate.height_variance[job.mask].mean()))
    assert 0.6 < rms((estimate.height - height)[job.mask]) / claimed < 1.3


@pytest.mark.parametrize("shift", [0.0, 0.4])
def test_response_in_place_of_the_one_before_is_the_same(shift: float) -> None:
    """With scans in register, and with displaced ones, which take other memory."""
    job = cylinder()
    estimator, rng, plant = HeightEstimator(job), np.random.default_rng(3), LayerModel.of(job)
    seen, pattern, height = np.ones(job.mask.shape, np.bool_), job.mask.astype(np.int32), np.zeros(job.mask.shape)
    estimate = kept = estimator.first(height + 3e-7 * rng.standard_normal(height.shape), seen)
    kept = Estimate.of_arrays({name: np.copy(value) for name, value in kept.arrays().items()})
    for layer in range(1, 13):
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(height.shape))
        moved = (1.0 - shift) * height + shift * np.roll(height, -1, axis=0)
        scan = moved + 3e-7 * rng.standard_normal(height.shape)
        before = kept
        kept = estimator.next(before, pattern, layer, scan, seen, in_place=True)
        estimate = estimator.next(estimate, pattern, layer, scan, seen)
        assert kept.response is before.response
        for name, value in estimate.arrays().items():
            np.testing.assert_array_equal(kept.arrays()[name], value, err_msg=f"{name} of layer {layer}")
    assert kept.registration.is_applied == (shift > 0.0)


def test_noise_is_learnt_from_unprinted_cells_and_none_means_that_scans_are_taken_as_they_are() -> None:
    job = cylinder()
    estimate, *_ = printed(job, HeightEstimator(job), 8, 1e-6)
    assert np.sqrt(estimate.noise_variance) == pytest.approx(1e-6, rel=0.05, abs=0.0)
    exact, _, scan = printed(job, HeightEstimator(job), 8, 0.0)
    assert exact.noise_variance == 0.0
    np.testing.assert_array_equal(exact.height, scan)


def test_noise_learnt_so_far_is_kept_where_a_scan_shows_no_unprinted_cells() -> None:
    job = cylinder()
    estimator = HeightEstimator(job)
    estimate, _, scan = printed(job, estimator, 4, 1e-6)
    blind = estimator.next(estimate, job.mask.astype(np.int32), 5, scan, job.mask)
    assert blind.noise_variance == estimate.noise_variance > 0.0


def test_noise_that_is_common_to_a_scan_is_not_taken_for_ink() -> None:
    job = cylinder()
    for common in (0.5, 1.0):
        estimate, *_ = printed(job, HeightEstimator(job), 10, 3e-6, common)
        assert estimate.ink_scale == pytest.approx(0.9, abs=0.02)


def test_repeated_scans_of_a_finished_surface_average_out() -> None:
    job = cylinder()
    rng, seen, nothing = np.random.default_rng(2), np.ones(job.mask.shape, np.bool_), np.zeros((35, 35), np.int32)
    surface = rng.uniform(0.0, 20e-6, job.mask.shape)
    estimator = HeightEstimator(job, sensor_noise_std=1e-6)
    estimate = estimator.first(surface + rng.normal(0.0, 1e-6, surface.shape), seen)
    for layer in range(1, 25):
        scan = surface + rng.normal(0.0, 1e-6, surface.shape)
        estimate = estimator.next(estimate, nothing, layer, scan, seen)
    assert rms(estimate.height - surface) == pytest.approx(1e-6 / 5.0, rel=0.3, abs=0.0)
    assert estimate.ink_scale == 1.0


def test_scan_taken_as_read_is_the_estimate() -> None:
    job = cylinder()
    estimate, _, scan = printed(job, HeightEstimator(job, take_as_read=True), 3, 1e-6)
    np.testing.assert_array_equal(estimate.height, scan)


def test_invalid_cells_are_predicted_their_variance_grows_and_in_the_end_they_are_untrusted() -> None:
    job = block(20, 20)
    pattern, seen = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_)
    estimator = HeightEstimator(job, untrusted_layers=3)
    estimate = estimator.first(np.zeros(seen.shape), seen)
    hidden = seen.copy()
    hidden[5, 6] = False
    surface = np.zeros(seen.shape)
    for layer in range(1, 6):
        before = estimate
        surface = LayerModel.of(job).layer(surface, pattern, layer)
        estimate = estimator.next(before, pattern, layer, np.where(hidden, surface, np.nan), hidden)
        assert estimate.height[5, 6] == pytest.approx(surface[5, 6], abs=1e-9)
        assert estimate.height_variance[5, 6] > before.height_variance[5, 6]
        assert estimate.unseen[5, 6] == layer
        np.testing.assert_array_equal(np.argwhere(estimate.untrusted), [[5, 6]] if layer > 3 else np.empty((0, 2)))
    surface = LayerModel.of(job).layer(surface, pattern, 6)
    again = estimator.next(estimate, pattern, 6, surface, seen)
    assert not again.unseen.any()
    assert not again.untrusted.any()


@pytest.mark.parametrize("factor", [1.0, np.random.default_rng(4).uniform(0.7, 2.0, (14, 12))])
def test_variances_of_the_droplets_of_a_layer_that_was_not_seen_add(factor: Any) -> None:
    """Each droplet by itself on the same rough surface: a tenth of what it adds to a cell is its standard deviation."""
    inks, rng = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), np.random.default_rng(5)
    job = block(14, 12, inks=inks)
    estimator = HeightEstimator(job, adapt_ink="off")
    surface, seen = rng.uniform(0.0, 12e-6, (14, 12)), np.ones((14, 12), np.bool_)
    pattern = np.where(job.mask, rng.integers(0, 3, (14, 12)), 0).astype(np.int32)
    table, alone = tuple((ink.h1, ink.h2, ink.h3) for ink in inks), np.zeros((14, 12))
    for cell in zip(*np.nonzero(pattern), strict=True):
        single = np.zeros_like(pattern)
        single[cell] = pattern[cell]
        alone += (lu_numpy.one_pass(surface, single, table, factor)[0] - surface) ** 2
    volumes = np.broadcast_to(factor, seen.shape).astype(np.float64)
    after = estimator.next(estimator.first(surface, seen), pattern, 1, surface, ~seen, volumes)
    np.testing.assert_allclose(after.height_variance, 0.1**2 * alone, rtol=1e-9, atol=1e-30)


def test_variance_before_the_next_scan_is_that_of_a_full_flat_layer_more() -> None:
    inks = (Ink(), Ink(5e-6, 0.9e-6, 0.4e-6))
    estimate = replace(Estimate.exact(np.zeros((3, 3)), inks), height_variance=np.full((3, 3), 2e-13))
    squares = 5e-6**2 + 4 * 0.9e-6**2 + 4 * 0.4e-6**2
    np.testing.assert_allclose(estimate.predicted_variance, 2e-13 + 0.1**2 * squares, rtol=1e-12)


def test_unmeasured_start_surface_is_bare_substrate() -> None:
    job = block()
    valid = np.zeros((job.nx, job.ny), np.bool_)
    np.testing.assert_array_equal(HeightEstimator(job).first(np.full(valid.shape, 7.0), valid).height, 0.0)


def test_cell_whose_droplets_never_come_follows_the_scan() -> None:
    job = block(20, 20)
    pattern, seen = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_)
    factor = np.ones(seen.shape)
    factor[10, 10] = 1e-9
    estimator, rng = HeightEstimator(job, sensor_noise_std=0.3e-6), np.random.default_rng(3)
    surface = np.zeros(seen.shape)
    estimate = estimator.first(surface, seen)
    for layer in range(1, 11):
        surface = LayerModel.of(job).layer(surface, pattern, layer, factor)
        scan = surface + rng.normal(0.0, 0.3e-6, surface.shape)
        estimate = estimator.next(estimate, pattern, layer, scan, seen)
    assert estimate.height[10, 10] == pytest.approx(surface[10, 10], abs=1e-6)


SECOND_INK = Ink(3.4e-6, 0.8e-6, 0.35e-6)


@pytest.mark.parametrize(
    ("model", "noise_std", "passes", "inks"),
    [
        ("scale", 0.5e-6, 1, (Ink(),)),
        ("scale", 0.0, 4, (Ink(),)),
        ("scale", None, 4, (Ink(),)),
        ("scale", None, 1, (Ink(), SECOND_INK)),
        ("full", 0.5e-6, 1, (Ink(),)),
        ("full", None, 4, (Ink(),)),
        ("full", 0.0, 1, (Ink(), SECOND_INK)),
        ("full", 0.5e-6, 4, (Ink(), SECOND_INK)),
        ("off", 0.5e-6, 1, (Ink(), SECOND_INK)),
    ],
)
def test_estimate_is_that_of_its_numpy_statement(
    model: InkModel, noise_std: float | None, passes: int, inks: tuple[Ink, ...]
) -> None:
    """Tilted scans of other inks on a rough substrate, cells that were not seen, and one whose droplets never come."""
    job, rng = block(15, 14, passes=passes, inks=inks), np.random.default_rng(6)
    job.mask[:, :6] = False
    ours = HeightEstimator(job, adapt_ink=model, sensor_noise_std=noise_std, register_scans=False)
    stated = estimator_numpy.Estimator(job, None if noise_std is None else noise_std**2, model)
    plant = LayerModel((Ink(3.9e-6, 0.5e-6, 0.15e-6), Ink(3.7e-6, 0.7e-6, 0.3e-6))[: len(inks)], passes)
    surface, factor = rng.uniform(0.0, 6e-6, job.mask.shape), 1.0 - 0.3 * rng.random(job.mask.shape)
    factor[7, 9] = 1e-9
    i, j = np.indices(surface.shape)
    seen = rng.random(surface.shape) < 0.93
    estimate, state = ours.first(surface, seen), stated.first(surface, seen)
    for layer in range(1, 5):
        drawn = rng.integers(1, len(inks) + 1, surface.shape)
        pattern = np.where(job.mask & (rng.random(surface.shape) < 0.7), drawn, 0).astype(np.int32)
        surface, seen = plant.layer(surface, pattern, layer, factor), rng.random(surface.shape) < 0.93
        scan = surface + rng.normal(0.0, 0.4e-6, surface.shape) + layer * (1e-6 + 0.1e-6 * i - 0.2e-6 * j)
        scan[1, 1] += 20e-6  # soiled
        estimate = ours.next(estimate, pattern, layer, scan, seen)
        state = stated.next(state, pattern, scan, seen)
        np.testing.assert_allclose(estimate.height, state.height, rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(estimate.height_variance, state.variance, rtol=1e-9, atol=0.0)
        np.testing.assert_array_equal(estimate.unseen, state.unseen)
        np.testing.assert_allclose(ink_table(estimate.inks), state.inks, rtol=1e-9, atol=0.0)
        assert estimate.noise_variance == pytest.approx(state.noise, rel=1e-9, abs=0.0)
        assert estimate.ink_scale == pytest.approx(
            stated.layer_height(state.inks) / stated.layer_height(stated.nominal), rel=1e-9, abs=0.0
        )
        if model == "full":
            errors = [state.learnt[each].error for each in ("full", "scale")]
            np.testing.assert_allclose(estimate.learnt.errors, errors, rtol=1e-9, atol=0.0)
    assert (0.6 < estimate.ink_scale < 0.95) == (model != "off")


def test_estimate_comes_back_from_arrays_bit_by_bit() -> None:
    estimate, *_ = printed(block(20, 20), HeightEstimator(block(20, 20)), 3, 1e-6)
    back = Estimate.of_arrays(estimate.arrays())
    for name, value in back.arrays().items():
        np.testing.assert_array_equal(value, estimate.arrays()[name], err_msg=name)
    assert back.inks == estimate.inks


def test_all_errors_of_the_options_are_reported_at_once() -> None:
    with pytest.raises(ValueError, match=r"adapt_ink is 'yes'.*sensor_noise_std is -1.*untrusted_layers is -2"):
        HeightEstimator(block(), adapt_ink="yes", sensor_noise_std=-1.0, untrusted_layers=-2)  # type: ignore[arg-type]

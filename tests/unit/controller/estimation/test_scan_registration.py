"""Scans that are shifted against the printer or blurred: found, corrected, and not imagined where there is nothing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

from inkloop.component import Ink, Job, Status
from inkloop.models.volume_area_deposition import VolumeAreaDeposition
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import SECOND, block, inputs_of
from support.long_proofs import rest_is_long
from support.numpy import registration_numpy

LAYERS_MAX = 60


@dataclass(frozen=True)
class Sensor:
    """A profile sensor written with SciPy, apart from that of the project: linear between cells, Gaussian spot."""

    shift: tuple[float, float] = (0.0, 0.0)  # [cells]
    scatter: float = 0.0  # from scan to scan [cells]
    spot: float = 0.0  # [cells]
    noise: float = 0.0  # [m]
    dropout: float = 0.0

    def scan(self, height: Any, rng: np.random.Generator) -> tuple[Any, Any]:
        shift = np.asarray(self.shift) + self.scatter * rng.standard_normal(2)
        seen = gaussian_filter(height, self.spot, mode="nearest", truncate=4.0) if self.spot else height
        i, j = np.indices(height.shape)
        reading = map_coordinates(seen, [i + shift[0], j + shift[1]], order=1, mode="nearest")
        valid = rng.random(height.shape) >= self.dropout
        return reading + self.noise * rng.standard_normal(height.shape), valid


def small_cylinder(seed: int = 0) -> Job:
    """Radius 10 cells, 150 um high."""
    i, j = np.indices((25, 25))
    mask = (i - 12) ** 2 + (j - 12) ** 2 <= 100
    return Job(25, 25, 263.256e-6, np.where(mask, 150e-6, 0.0), mask, seed=seed)


@dataclass(frozen=True)
class Print:
    """A print's last outputs, those by layer, and error of the surface over the part [m]."""

    outputs: list[dict[str, Any]]
    error: Any


def printed(job: Job, sensor: Sensor, seed: int = 0, variation: float = 0.2, **options: Any) -> Print:
    controller, plant = LayerMpcController(job, **options), LayerModel.of(job)
    droplets, readings = np.random.default_rng(seed), np.random.default_rng(1000 + seed)
    height, outputs = np.zeros((job.nx, job.ny)), []

    def inputs(layer: int) -> Any:
        reading, valid = sensor.scan(height, readings)
        return inputs_of(job, reading, layer, valid)

    controller.initialize(0, inputs(0))
    for layer in range(LAYERS_MAX):
        outputs.append(dict(controller.do_step(layer * SECOND, SECOND, inputs(layer))))
        if outputs[-1]["status"] == Status.DONE:
            break
        factor = 1.0 - variation * droplets.random(height.shape)
        height = plant.layer(height, outputs[-1]["pattern"], layer + 1, factor)
    return Print(outputs, (height - job.target_height)[job.mask])


@pytest.mark.system
@pytest.mark.parametrize(
    "shift",
    [(-0.6, 1.0), *(pytest.param(shift, marks=pytest.mark.long) for shift in ((0.1, 0.0), (0.25, 0.0), (0.5, 0.5)))],
)
def test_shift_is_known_after_ten_layers_and_leaves_the_part_as_good_as_without(shift: tuple[float, float]) -> None:
    job = small_cylinder()
    found = printed(job, Sensor(shift))
    for axis, value in zip("xy", shift, strict=True):
        after_ten, std = (float(found.outputs[10][f"scan_shift_{name}"]) / job.pitch for name in (axis, "std"))
        assert after_ten == pytest.approx(value, abs=0.02)
        assert abs(after_ten - value) < 4.0 * std < 0.05
    assert np.abs(found.error).mean() < 0.5e-6
    assert found.error.max() < 3e-6


@pytest.mark.system
@pytest.mark.parametrize("spot", rest_is_long([0.5, 1.0], 1))
def test_wide_spot_is_found_and_leaves_the_part_as_good_as_without(spot: float) -> None:
    job = small_cylinder()
    found = printed(job, Sensor(spot=spot))
    assert float(found.outputs[10]["scan_spot_radius"]) == pytest.approx(spot * job.pitch, rel=0.05, abs=0.0)
    assert np.abs(found.error).mean() < 0.5e-6
    assert found.error.max() < 3e-6


@pytest.mark.system
def test_droplets_whose_shape_is_learnt_are_not_taken_for_wide_ones_where_the_spot_is_wide() -> None:
    """Wide droplets spread the growth of one layer, a wide spot the whole wall: without a look for it 8 um are left."""
    job = small_cylinder()
    found = printed(job, Sensor(spot=1.0), adapt_ink="full", horizon=2)
    assert float(found.outputs[10]["scan_spot_radius"]) == pytest.approx(job.pitch, rel=0.1, abs=0.0)
    assert np.abs(found.error).mean() < 1e-6
    assert found.error.max() < 6e-6


def test_invalid_reading_of_a_shifted_scan_leaves_that_cell_unseen_which_it_looks_at() -> None:
    job, sensor, rng = small_cylinder(), Sensor((1.0, -2.0)), np.random.default_rng(0)
    estimator, plant = HeightEstimator(job), LayerModel.of(job)
    pattern, height, seen = job.mask.astype(np.int32), np.zeros((25, 25)), np.ones((25, 25), np.bool_)
    estimate = estimator.first(height, seen)
    for layer in range(1, 7):
        height = plant.layer(height, pattern, layer)
        valid = seen.copy()
        valid[12, 8] = layer < 6
        estimate = estimator.next(estimate, pattern, layer, sensor.scan(height, rng)[0], valid)
    assert estimate.registration.is_applied
    assert np.argwhere(estimate.unseen[5:20, 5:20]).tolist() == [[13 - 5, 6 - 5]]


@pytest.mark.parametrize(
    "sensor",
    [
        pytest.param(Sensor(scatter=0.1), marks=pytest.mark.long),
        Sensor((0.25, 0.0), spot=0.5, noise=1e-6, dropout=0.1),
    ],
    ids=["scatter", "all"],
)
@pytest.mark.system
def test_shift_that_scatters_and_everything_at_once_do_little_harm(sensor: Sensor) -> None:
    found = printed(small_cylinder(), sensor)
    assert np.abs(found.error).mean() < 0.6e-6
    assert found.error.max() < 5e-6


@pytest.mark.system
@pytest.mark.long
def test_shift_that_is_not_looked_for_ruins_the_part_up_to_the_cap() -> None:
    """What the others would be without registration. The cap is where 20 full layers, one in reserve and five standard
    deviations of 20 droplets end; chance and what neighbours spill add to it."""
    found = printed(small_cylinder(), Sensor((0.25, 0.0)), register_scans=False)
    droplet_std = 0.1 * np.sqrt(4.4**2 + 4 * 0.6**2 + 4 * 0.2**2) * 1e-6
    cap = 21 * 7.6e-6 + 5.0 * droplet_std * np.sqrt(20.0)
    assert 10e-6 < found.error.max() < cap - 150e-6 + 3e-6


@pytest.mark.system
@pytest.mark.parametrize(
    "sensor",
    [Sensor(noise=1e-6), *(pytest.param(sensor, marks=pytest.mark.long) for sensor in (Sensor(), Sensor(dropout=0.1)))],
    ids=["noisy", "exact", "lost"],
)
def test_sensor_in_register_prints_bit_by_bit_as_if_nothing_was_looked_for(sensor: Sensor) -> None:
    looked, not_looked = (printed(small_cylinder(), sensor, register_scans=asked, horizon=2) for asked in (True, False))
    np.testing.assert_array_equal(looked.error, not_looked.error)
    assert looked.outputs[-1]["scan_spot_radius"] == 0.0


def registered(job: Job, scan: Callable[[Any], Any], layers: int, unknown: bool = False) -> Estimate:
    """The estimate after full layers and their scans; the last layer unknown, if wanted."""
    estimator, plant, seen = HeightEstimator(job), LayerModel.of(job), np.ones(job.mask.shape, np.bool_)
    height, pattern = np.zeros(job.mask.shape), job.mask.astype(np.int32)
    estimate = estimator.first(scan(height), seen)
    for layer in range(1, layers + 1):
        height = plant.layer(height, pattern, layer)
        take = estimator.after_unknown if unknown and layer == layers else estimator.next
        estimate = take(estimate, pattern, layer, scan(height), seen)
    return estimate


def test_layer_that_was_abandoned_shows_no_displacement() -> None:
    job, rng = block(20, 20), np.random.default_rng(1)

    def scan(height: Any) -> Any:
        return Sensor((0.3, 0.0)).scan(height, rng)[0]

    assert not registered(job, scan, 1, unknown=True).registration.has_shift
    assert registered(job, scan, 1).registration.has_shift


@pytest.mark.parametrize("shift", [(0.02, -0.03), (0.3, 0.2)], ids=["too little", "corrected"])
def test_layer_that_was_abandoned_makes_what_is_known_of_the_shift_older(shift: tuple[float, float]) -> None:
    """By a step from scan to scan; nothing of it is forgotten, whether scans are corrected for it or not."""
    job, rngs = block(20, 17), [np.random.default_rng(1) for _ in range(2)]
    sensor = Sensor(shift, noise=0.2e-6)
    before = registered(job, lambda height: sensor.scan(height, rngs[0])[0], 5).registration
    after = registered(job, lambda height: sensor.scan(height, rngs[1])[0], 6, unknown=True).registration
    assert np.abs(before.estimate[:2]).min() > 0.005
    assert before.has_shift == after.has_shift == (shift == (0.3, 0.2))
    np.testing.assert_allclose(after.estimate, before.estimate, rtol=1e-9, atol=0.0)
    older = np.diag([before.steps_variance, before.steps_variance, 1e-6])
    np.testing.assert_allclose(after.covariance, before.covariance + older, rtol=1e-6, atol=1e-12)
    assert (after.scans, after.misfit) == (before.scans, before.misfit)


def by_height_alone(sensor: Sensor, seed: int) -> tuple[list[bool], Any, Any]:
    """A cylinder on the plant of Wu and Chiu, whose droplets no ink describes; a droplet falls where one is missing.

    Whether scans were corrected, by layer; errors of the last estimate and of the last scan [m].
    """
    i, j = np.indices((25, 25))
    mask = (i - 12) ** 2 + (j - 12) ** 2 <= 100
    ink = Ink(4.096e-6, 0.5586e-6, 0.1862e-6)
    job = Job(25, 25, 90e-6, np.where(mask, 70e-6, 0.0), mask, inks=(ink,))
    plant, rng = VolumeAreaDeposition(guard=True, limit_gains=True), np.random.default_rng(seed)
    estimator, surface, corrected = HeightEstimator(job), plant.start(np.zeros((25, 25))), []
    scan, seen = sensor.scan(surface.height, rng)
    estimate = estimator.first(scan, seen)
    for layer in range(1, 26):
        missing = mask & (estimate.height < job.target_height - 0.5 * ink.layer_height)
        pattern = (missing if missing.any() else mask & (rng.random(mask.shape) < 0.1)).astype(np.int32)
        surface = plant.layer(surface, pattern, layer, 1.0 - 0.2 * rng.random(mask.shape))
        scan, seen = sensor.scan(surface.height, rng)
        estimate = estimator.next(estimate, pattern, layer, scan, seen)
        corrected.append(bool(estimate.registration.has_shift))
    return corrected, estimate.height - surface.height, scan - surface.height


def test_shift_that_droplets_of_another_kind_feign_is_taken_back() -> None:
    prints = [by_height_alone(Sensor(), seed) for seed in range(8)]
    feigned = [corrected for corrected, _, _ in prints if any(corrected)]
    assert len(feigned) >= 3  # or the test shows nothing
    assert all(sum(corrected) <= 3 for corrected in feigned)
    for _, error, _ in prints:
        assert np.abs(error).max() < 0.1e-6  # 25 um and more where a correction stays


@pytest.mark.parametrize("shift", [0.1, 0.25])
def test_shift_under_droplets_of_another_kind_leaves_no_estimate_worse_than_the_scan(shift: float) -> None:
    corrected, of_estimate, of_scan = by_height_alone(Sensor((shift, 0.0)), 0)
    assert any(corrected)
    assert np.sqrt(np.mean(of_estimate**2)) < 1.1 * np.sqrt(np.mean(of_scan**2))


def test_saved_estimate_is_restored_bit_by_bit() -> None:
    job, rng = small_cylinder(), np.random.default_rng(1)
    estimate = registered(job, lambda height: Sensor((0.3, 0.2)).scan(height, rng)[0], 3)
    restored = Estimate.of_arrays(estimate.arrays())
    assert estimate.registration.has_shift
    for name, value in estimate.arrays().items():
        np.testing.assert_array_equal(restored.arrays()[name], value)


def test_scans_of_a_flat_surface_show_no_displacement_and_leave_it_as_unsure_as_it_was() -> None:
    """Half a cell, and the step from scan to scan: 0.03 cells of the shift, 0.001 cells^2 of the spot."""
    job = block(14, 13, height=30e-6)
    seen, nothing = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape, np.int32)
    estimator = HeightEstimator(job, sensor_noise_std=0.3e-6)
    estimate = estimator.first(np.zeros(seen.shape), seen)
    for layer in range(4):
        found = estimate.registration
        np.testing.assert_array_equal(found.estimate, 0.0)
        variances = [0.25 + layer * 0.03**2, 0.25 + layer * 0.03**2, 0.25 + layer * 0.001**2]
        np.testing.assert_allclose(found.covariance, np.diag(variances), rtol=1e-12, atol=0.0)
        assert found.steps_variance == pytest.approx(0.03**2, rel=1e-12, abs=0.0)
        assert found.misfit == pytest.approx(0.05**2, rel=1e-12, abs=0.0)
        assert found.scans == layer
        assert not found.is_applied
        shown = found.displacement
        assert (shown.shift_x, shown.shift_y, shown.spot_radius) == (0.0, 0.0, 0.0)
        assert shown.shift_std == pytest.approx(np.sqrt(variances[0]), rel=1e-12, abs=0.0)
        estimate = estimator.next(estimate, nothing, layer + 1, np.zeros(seen.shape), seen)


def test_errors_of_readings_at_walls_are_learnt_down_to_a_least_one() -> None:
    """Scans that agree say 0.01 of the curvature, with a weight of 0.3 against what was known, 0.05 at first."""
    job = block(14, 13, height=30e-6)
    seen, nothing = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape, np.int32)
    estimator, surface = HeightEstimator(job, sensor_noise_std=0.3e-6), np.where(job.mask, 100e-6, 0.0)
    estimate, misfit = estimator.first(surface, seen), 0.05**2
    for layer in range(1, 4):
        estimate = estimator.next(estimate, nothing, layer, surface, seen)
        misfit = 0.7 * misfit + 0.3 * 0.01**2
        assert estimate.registration.misfit == pytest.approx(misfit, rel=1e-9, abs=0.0)
        np.testing.assert_allclose(estimate.registration.estimate, 0.0, atol=1e-12)


def test_shift_is_never_more_than_four_cells_and_no_response_is_kept_where_none_is_looked_for() -> None:
    job = block(24, 23, height=60e-6)
    seen, nothing = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape, np.int32)
    surface = np.where(job.mask, 100e-6, 0.0)
    estimator = HeightEstimator(job, sensor_noise_std=0.3e-6)
    estimate = estimator.first(surface, seen)
    for layer in range(1, 12):
        estimate = estimator.next(estimate, nothing, layer, np.roll(surface, min(layer, 9), 0), seen)
        assert np.abs(estimate.registration.estimate[:2]).max() <= 4.0
        assert 0.0 <= estimate.registration.estimate[2] <= 16.0
    without = HeightEstimator(job, register_scans=False)
    estimate = without.first(surface, seen)
    np.testing.assert_array_equal(estimate.response, 0.0)
    np.testing.assert_array_equal(without.next(estimate, nothing, 1, surface, seen).response, 0.0)


@pytest.mark.parametrize(
    ("shift", "spot", "passes", "ny", "found"),
    [
        ((1.3, -1.6), 0.0, 1, 21, (True, True)),
        ((-0.7, 1.4), 0.0, 4, 21, (True, False)),
        ((0.0, 0.0), 0.8, 1, 21, (True, True)),
        ((0.0, 0.045), 0.0, 1, 21, (False, False)),
        ((-0.3, 0.8), 0.0, 1, 45, (True, False)),
    ],
    ids=["shift", "passes", "spot", "little", "back"],
)
def test_registration_is_that_of_its_numpy_statement(
    shift: tuple[float, float], spot: float, passes: int, ny: int, found: tuple[bool, bool]
) -> None:
    """Tilted, noisy scans of a rough block on an oblong grid beside an older one, shifted from the second scan on."""
    job, rng = block(26, ny, passes=passes, inks=(Ink(4.1e-6, 0.7e-6, 0.3e-6),)), np.random.default_rng(4)
    job.mask[:12] = False
    ours = HeightEstimator(job, adapt_ink="off", sensor_noise_std=0.4e-6)
    stated = registration_numpy.Estimator(job, 0.16e-12)
    plant, (i, j) = LayerModel.of(job), np.indices(job.mask.shape)
    surface = rng.uniform(2e-6, 5e-6, job.mask.shape) + np.where((abs(i - 5) < 3) & (abs(j - 10) < 6), 90e-6, 0.0)
    surface[job.mask] += 40e-6
    sensor = Sensor(shift, spot=spot, noise=0.4e-6, dropout=0.03)
    scan, seen = Sensor(noise=0.4e-6, dropout=0.03).scan(surface, rng)
    estimate, state = ours.first(scan, seen), stated.first(scan, seen)
    np.testing.assert_allclose(estimate.response, state.response, rtol=1e-9, atol=1e-18)
    for layer in range(1, 4):
        pattern = (job.mask & (rng.random(job.mask.shape) < 0.8)).astype(np.int32)
        surface = plant.layer(surface, pattern, layer, 1.0 - 0.2 * rng.random(job.mask.shape))
        scan, seen = sensor.scan(surface, rng)
        scan += layer * (1e-6 + 0.1e-6 * i - 0.05e-6 * j)
        estimate, state = ours.next(estimate, pattern, layer, scan, seen), stated.next(state, pattern, scan, seen)
        for name, value in vars(state.found).items():
            np.testing.assert_allclose(
                getattr(estimate.registration, name), value, rtol=1e-6, atol=1e-12, err_msg=f"{name} {layer}"
            )
        shown = tuple(vars(estimate.registration.displacement).values())
        np.testing.assert_allclose(shown, state.found.displacement, rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(estimate.response, state.response, rtol=1e-6, atol=1e-14)
        np.testing.assert_allclose(estimate.height, state.height, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(estimate.height_variance, state.variance, rtol=1e-6, atol=0.0)
        np.testing.assert_array_equal(estimate.unseen, state.unseen)
    assert (estimate.registration.has_shift, estimate.registration.has_wide_spot) == found

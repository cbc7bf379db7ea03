"""The estimated surface: what a scan is worth against what was expected."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.core import bindings
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator, InkModel
from inkloop_controller.layer_controller import LayerController
from inkloop_controller.model import LayerModel
from support.closed_loop import block, cylinder, inputs_of


def small(rng: Any, shape: Any) -> Any:
    return 1.0 - 0.2 * rng.random(shape)


def printed(
    job: Job, estimator: HeightEstimator, layers: int, noise_std: float, common: float = 0.0, volumes: Any = small
) -> Any:
    """(estimate, surface, last scan) after full layers of varying droplets; `common`: share of the noise in a scan."""
    rng, plant = np.random.default_rng(1), LayerModel.of(job)
    seen, pattern = np.ones(job.mask.shape, np.bool_), job.mask.astype(np.int32)
    height = np.zeros(job.mask.shape)

    def scan() -> Any:
        shared, own = rng.standard_normal(), rng.standard_normal(height.shape)
        return height + noise_std * (np.sqrt(common) * shared + np.sqrt(1.0 - common) * own)

    estimate, measured = estimator.first(scan(), seen), height
    for layer in range(1, layers + 1):
        height = plant.layer(height, pattern, layer, volumes(rng, height.shape))
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


def test_noise_is_learnt_from_unprinted_cells_and_none_means_that_scans_are_taken_as_they_are() -> None:
    job = cylinder()
    estimate, *_ = printed(job, HeightEstimator(job), 8, 1e-6)
    assert estimate.figures.noise_std == pytest.approx(1e-6, rel=0.1, abs=0.0)
    exact, _, scan = printed(job, HeightEstimator(job), 8, 0.0)
    assert exact.figures.noise_std < 1e-9
    np.testing.assert_allclose(exact.height, scan, rtol=0.0, atol=1e-7)


def uniform(rng: Any, shape: Any) -> Any:
    return rng.uniform(1.0 - 0.08 * np.sqrt(3.0), 1.0 + 0.08 * np.sqrt(3.0), shape)


def normal(rng: Any, shape: Any) -> Any:
    return rng.normal(1.0, 0.08, shape)


def normal_but_for_a_few(rng: Any, shape: Any) -> Any:
    return np.where(rng.random(shape) < 0.02, 0.2, normal(rng, shape))


@pytest.mark.parametrize("volumes", [uniform, normal, normal_but_for_a_few])
def test_scatter_of_droplets_is_learnt_whatever_their_distribution(volumes: Any) -> None:
    job = cylinder()
    estimate, *_ = printed(job, HeightEstimator(job), 12, 0.0, volumes=volumes)
    assert estimate.figures.droplet_std == pytest.approx(0.08, rel=0.06, abs=0.0)


@pytest.mark.parametrize("common", [0.5, 1.0])
def test_noise_that_is_common_to_a_scan_is_not_taken_for_ink(common: float) -> None:
    job = cylinder()
    estimate, *_ = printed(job, HeightEstimator(job), 10, 3e-6, common)
    assert estimate.ink_scale == pytest.approx(0.9, abs=0.08)


def test_repeated_scans_of_a_finished_surface_average_out() -> None:
    """But for their datum, which ground alone shows."""
    job = cylinder()
    rng, seen, nothing = np.random.default_rng(2), np.ones(job.mask.shape, np.bool_), np.zeros((35, 35), np.int32)
    surface = rng.uniform(0.0, 20e-6, job.mask.shape)
    estimator = HeightEstimator(job, sensor_noise_std=1e-6, flat_ground=False, register_scans=False)
    estimate = estimator.first(surface + rng.normal(0.0, 1e-6, surface.shape), seen)
    for layer in range(1, 25):
        scan = surface + rng.normal(0.0, 1e-6, surface.shape)
        estimate = estimator.next(estimate, nothing, layer, scan, seen)
    error, (u, w) = estimate.height - surface, np.indices(surface.shape) / 17.0 - 1.0
    terms = np.stack([np.ones_like(u), u, w, u * u, u * w, w * w], axis=-1).reshape(-1, 6)
    datum = (terms @ np.linalg.lstsq(terms, error.ravel(), rcond=None)[0]).reshape(error.shape)
    assert rms(error - datum) == pytest.approx(1e-6 / 5.0, rel=0.1, abs=0.0)
    assert rms(datum) < 0.5e-6
    assert estimate.ink_scale == pytest.approx(1.0, abs=1e-9)


def test_scan_taken_as_read_is_the_estimate() -> None:
    job = cylinder()
    estimate, _, scan = printed(job, HeightEstimator(job, take_as_read=True), 3, 1e-6)
    np.testing.assert_array_equal(estimate.height, scan)


def test_cells_that_are_not_read_are_predicted_where_scans_are_taken_as_read() -> None:
    """Cell (5, 6) is not seen in scans 1 and 2."""
    job = block(20, 20)
    estimator, plant = HeightEstimator(job, take_as_read=True, flat_ground=False), LayerModel.of(job)
    pattern, seen = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_)
    hidden, surface = seen.copy(), np.full(seen.shape, 3e-6)
    hidden[5, 6] = False
    estimate = start = estimator.first(surface, seen)
    for layer in (1, 2):
        expected = plant.layer(estimate.height, pattern, layer)
        surface = plant.layer(surface, pattern, layer) + 1e-6
        estimate = estimator.next(estimate, pattern, layer, surface, hidden)
        np.testing.assert_array_equal(estimate.height, np.where(hidden, surface, expected))
        np.testing.assert_array_equal(estimate.height_variance, np.where(hidden, 0.0, start.height_variance))
        np.testing.assert_array_equal(estimate.state["unseen"], np.where(hidden, 0, layer))
    assert not estimator.next(estimate, pattern, 3, surface, seen).state["unseen"].any()


def test_invalid_cells_are_predicted_their_variance_grows_and_unknown_ones_are_untrusted() -> None:
    """Cell (5, 6) is never seen, (9, 12) in scan 0 alone."""
    job = block(20, 20)
    pattern, seen = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_)
    estimator = HeightEstimator(job, untrusted_layers=3, flat_ground=False)
    hidden = seen.copy()
    hidden[5, 6] = False
    estimate = first = estimator.first(np.zeros(seen.shape), hidden)
    hidden[9, 12] = False
    surface = np.zeros(seen.shape)
    for layer in range(1, 6):
        surface = LayerModel.of(job).layer(surface, pattern, layer)
        estimate = estimator.next(estimate, pattern, layer, np.where(hidden, surface, np.nan), hidden)
        assert estimate.height[5, 6] == pytest.approx(surface[5, 6], abs=1e-9)
        assert estimate.height_variance[9, 12] > first.height_variance[9, 12]
        assert estimate.state["unseen"][5, 6] == layer + 1
        assert estimate.figures.unseen_cells == (layer > 2)
    surface = LayerModel.of(job).layer(surface, pattern, 6)
    again = estimator.next(estimate, pattern, 6, surface, seen)
    assert not again.state["unseen"].any()
    assert not again.figures.unseen_cells


def test_ground_is_flat_unless_the_job_has_a_start_surface_or_it_is_told_to_be() -> None:
    printed_on = replace(block(), height_start=np.full((10, 9), 1e-4))
    for job, options, is_flat in (
        (block(), {}, True), (printed_on, {}, False), (printed_on, {"flat_ground": True}, True),
        (block(), {"flat_ground": False}, False),
    ):  # fmt: skip
        assert HeightEstimator(job, **options).options["flat_ground"] is is_flat  # type: ignore[arg-type]


def test_surface_that_is_known_for_sure_has_no_variance_and_no_doubt() -> None:
    estimator, exact = HeightEstimator(block()), Estimate.exact(np.zeros((10, 9)), (Ink(),))
    assert not exact.height_variance.any()
    assert (exact.ink_scale, exact.figures.surprise, exact.state) == (1.0, 1.0, {})
    assert estimator.trust_again(exact) is exact
    other = Estimate.exact(np.zeros((9, 10)), (Ink(),))
    scan = np.zeros((10, 9)), np.zeros((10, 9), np.int32), 1, np.zeros((10, 9)), np.ones((10, 9), np.bool_)
    with pytest.raises(ValueError, match=r"height has shape \(9, 10\); needs \(10, 9\)"):
        estimator.next(other, *scan[1:])
    with pytest.raises(ValueError, match="the estimate before has no state"):
        estimator.next(exact, *scan[1:])


def test_trust_after_a_look_is_another_estimate() -> None:
    estimator, flat = HeightEstimator(block()), np.zeros((10, 9))
    before = estimator.first(flat, np.ones((10, 9), np.bool_))
    assert before.block is not None
    copy = before.block.copy()
    after = estimator.trust_again(before)
    np.testing.assert_array_equal(before.block, copy)
    assert after.block is not None
    assert (after.block != copy).any()


@pytest.mark.parametrize(("unseen", "is_blind"), [(0.5, False), (0.51, True)])
def test_print_is_blind_after_six_scans_that_miss_more_than_half_of_the_part(unseen: float, is_blind: bool) -> None:
    """And trusted again after one that sees it."""
    job = block(14, 14)
    seen, surface = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)
    cells = np.flatnonzero(job.mask)
    hidden = seen.copy()
    hidden.flat[cells[: round(unseen * cells.size)]] = False
    estimator, nothing = HeightEstimator(job, take_as_read=True), np.zeros(job.mask.shape, np.int32)
    estimate, found = estimator.first(surface, seen), []
    for layer in range(1, 7):
        estimate = estimator.next(estimate, nothing, layer, surface, hidden)
        found.append(bool(estimate.figures.reasons & UntrustedReason.BLIND))
        assert estimate.figures.blind_share == pytest.approx(unseen, abs=0.01)
    assert found == [False] * 5 + [is_blind]
    estimate = estimator.next(estimate, nothing, 7, surface, seen)
    estimate = estimator.next(estimate, nothing, 8, surface, hidden)
    assert not estimate.figures.reasons


def test_unmeasured_start_surface_is_bare_substrate() -> None:
    job = replace(block(), height_start=np.full((block().nx, block().ny), 2e-6))
    valid = np.zeros((job.nx, job.ny), np.bool_)
    valid[0] = True
    height = HeightEstimator(job).first(np.full(valid.shape, 2e-6), valid).height
    np.testing.assert_array_equal(height, np.where(valid, 2e-6, 0.0))


def test_first_scan_with_hardly_a_reading_is_refused() -> None:
    job = block(20, 20)
    valid = np.zeros((20, 20), np.bool_)
    for row in (7, 8):  # the least is 8 readings of 400
        valid.flat[:row] = True
        if row == 8:
            HeightEstimator(job).first(np.zeros(valid.shape), valid)
            continue
        with pytest.raises(ValueError, match=r"first scan has readings on less than 2 % of the cells"):
            HeightEstimator(job).first(np.zeros(valid.shape), valid)


SPIKE = (10, 10)


def spiked(layer_of_spike: int, spike: float, layers: int, is_real: bool) -> list[tuple[Estimate, Any]]:
    """Estimates and surfaces after full layers; in one of them a cell is read so much higher [m], or it is."""
    noise = 0.2e-6
    job, rng = block(20, 20, height=100e-6), np.random.default_rng(4)
    estimator, plant = HeightEstimator(job, sensor_noise_std=noise, register_scans=False), LayerModel.of(job)
    pattern, seen, surface = job.mask.astype(np.int32), np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)
    found = [(estimator.first(surface, seen), surface)]
    for layer in range(1, layers + 1):
        surface = plant.layer(surface, pattern, layer, 1.0 - 0.2 * rng.random(surface.shape))
        surface[SPIKE] += spike if is_real and layer == layer_of_spike else 0.0
        scan = surface + noise * rng.standard_normal(surface.shape)
        scan[SPIKE] += spike if not is_real and layer == layer_of_spike else 0.0
        found.append((estimator.next(found[-1][0], pattern, layer, scan, seen), surface))
    return found


@pytest.mark.parametrize("spike", [20e-6, -20e-6])
def test_spike_that_comes_once_hardly_counts(spike: float) -> None:
    for estimate, surface in spiked(4, spike, 7, is_real=False):
        assert abs(estimate.height - surface)[SPIKE] < 2e-6
        assert not estimate.figures.reasons


@pytest.mark.parametrize("step", [20e-6, -15e-6])
def test_reading_that_is_off_by_the_same_again_is_the_cells(step: float) -> None:
    """Something has fallen on the part, or out of it."""
    found = spiked(4, step, 9, is_real=True)
    assert abs(found[4][0].height - found[4][1])[SPIKE] > 0.5 * abs(step)
    for estimate, surface in found[6:]:
        assert abs(estimate.height - surface)[SPIKE] < 1e-6


def test_droplets_that_stray_are_believed_of_an_exact_sensor() -> None:
    """From the third scan on, when strays have lasted, though flow has levelled some in the meantime."""
    job, rng = cylinder(), np.random.default_rng(1)
    plant, estimator = LayerModel.of(job), HeightEstimator(job)
    seen, pattern, height = np.ones(job.mask.shape, np.bool_), job.mask.astype(np.int32), np.zeros(job.mask.shape)
    estimate = estimator.first(height, seen)
    for layer in range(1, 13):
        strays = (pattern > 0) & (rng.random(height.shape) < 0.01)
        landed = np.where(strays, 0, pattern) + np.roll(strays, 2, axis=0)
        volume = landed * (1.0 - 0.2 * rng.random(height.shape))
        height = plant.layer(height, (landed > 0).astype(np.int32), layer, volume)
        estimate = estimator.next(estimate, pattern, layer, height, seen)
        if layer > 3:
            np.testing.assert_allclose(estimate.height, height, rtol=0.0, atol=0.1e-6)


def test_estimate_comes_back_from_its_state_bit_by_bit() -> None:
    estimator = HeightEstimator(block(20, 20))
    estimate, *_ = printed(block(20, 20), estimator, 3, 1e-6)
    back = estimator.estimate(np.array(estimate.block))
    assert back.figures == estimate.figures
    assert back.inks == estimate.inks
    for name in ("height", "height_variance", "dead", "capped"):
        np.testing.assert_array_equal(getattr(back, name), getattr(estimate, name), err_msg=name)


def test_state_that_is_none_is_refused() -> None:
    estimator = HeightEstimator(block(20, 20))
    other = HeightEstimator(block(9, 9)).first(np.zeros((9, 9)), np.ones((9, 9), np.bool_)).block
    assert other is not None
    for size in (5, other.size):
        with pytest.raises(ValueError, match="block has shape"):
            estimator.estimate(np.zeros(size, np.uint8))
    seen, none = np.ones((20, 20), np.bool_), np.zeros((20, 20), np.int32)
    exact = Estimate.exact(np.zeros((20, 20)), (Ink(),))
    with pytest.raises(ValueError, match="has no state; needs one"):
        estimator.next(exact, none, 1, exact.height, seen)
    assert estimator.trust_again(exact) is exact
    turned = HeightEstimator(block(25, 16)).first(np.zeros((25, 16)), np.ones((25, 16), np.bool_))
    with pytest.raises(ValueError, match=r"height has shape \(25, 16\); needs \(20, 20\)"):
        estimator.next(turned, none, 1, exact.height, seen)
    with pytest.raises(ValueError, match=r"factor has shape \(16, 25\)"):
        estimator.next(estimator.first(exact.height, seen), none, 1, exact.height, seen, np.ones((16, 25)))


def test_surface_that_is_known_for_sure_has_no_variance_and_nominal_ink() -> None:
    exact = Estimate.exact(np.full((3, 2), 5e-6), (Ink(),))
    assert not exact.height_variance.any()
    assert not exact.dead.any()
    assert not exact.capped.any()
    assert (exact.ink_scale, exact.figures.surprise, exact.figures.reasons, dict(exact.state)) == (1.0, 1.0, 0, {})


def test_all_errors_of_the_options_are_reported_at_once() -> None:
    with pytest.raises(ValueError, match=r"adapt_ink is 'yes'.*sensor_noise_std is -1.*untrusted_layers is -2"):
        HeightEstimator(block(), adapt_ink="yes", sensor_noise_std=-1.0, untrusted_layers=-2)  # type: ignore[arg-type]


NX, NY = 301, 517  # enough cells for three threads; neither bands nor chunks of rows end together
LAYERS, NOISE_M, SHIFT = 3, 0.3e-6, 0.4


def estimates(threads: int, adapt_ink: InkModel, passes: int, shift: float) -> list[Estimate]:
    """After each of a few layers with gaps, on scans with holes that are shifted by so many cells."""
    rng = np.random.default_rng(5)
    part = np.zeros((NX, NY), np.bool_)
    part[3:-3, 2:-2] = True
    job = Job(NX, NY, 1e-4, np.where(part, 1e-4, 0.0), part, (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6)), passes=passes)
    estimator, height = HeightEstimator(job, adapt_ink=adapt_ink, threads=threads), np.zeros((NX, NY))
    found = [estimator.first(NOISE_M * rng.standard_normal(height.shape), np.ones((NX, NY), np.bool_))]
    for layer in range(1, 1 + LAYERS):
        pattern = np.where(part & (rng.random((NX, NY)) < 0.8), rng.integers(1, 3, (NX, NY)), 0).astype(np.int32)
        order = (0, 1, 2, 3) if passes == 4 else ()
        height = bindings.layer(height, pattern, job.inks, order, factor=1.0 - 0.2 * rng.random((NX, NY)))
        read = (1.0 - shift) * height + shift * np.roll(height, -1, axis=0)
        scan = read + NOISE_M * rng.standard_normal(height.shape)
        found.append(estimator.next(found[-1], pattern, layer, scan, rng.random((NX, NY)) < 0.98))
    return found


@pytest.mark.parametrize(("adapt_ink", "passes", "shift"), [("scale", 1, 0.0), ("full", 4, 0.0), ("scale", 1, SHIFT)])
def test_threads_change_no_bit_of_an_estimate(adapt_ink: InkModel, passes: int, shift: float) -> None:
    alone, together = (estimates(threads, adapt_ink, passes, shift) for threads in (1, 3))
    assert shift == 0.0 or alone[-1].figures.is_displaced
    for one, other in zip(alone, together, strict=True):
        assert one.figures == other.figures
        for name, value in one.state.items():
            assert value.tobytes() == other.state[name].tobytes(), name


NOISE = 1e-6
UNKNOWN = 6


def half_jetted(job: Job) -> Any:
    """The part up to the middle line: there the head stopped."""
    return np.where(np.indices(job.mask.shape)[0] < job.nx // 2, job.mask, 0).astype(np.int32)


def printed_with_an_unknown_layer(unknown_layer: int, noise: float = NOISE) -> tuple[Job, Estimate, Estimate, Any]:
    """The estimates before and after the layer that half of was jetted, and the surface; droplets bring 80 %."""
    job, rng = cylinder(), np.random.default_rng(2)
    estimator, plant, whole = HeightEstimator(job), LayerModel.of(job).scaled(0.8), job.mask.astype(np.int32)
    seen, height = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)

    def scan() -> Any:
        return height + noise * rng.standard_normal(height.shape)

    estimate = before = estimator.first(scan(), seen)
    for layer in range(1, unknown_layer + 1):
        before, is_unknown = estimate, layer == unknown_layer
        height = plant.layer(height, half_jetted(job) if is_unknown else whole, layer)
        estimate = estimator.next(before, whole, layer, scan(), seen, is_unknown=is_unknown)
    return job, before, estimate, height


@pytest.mark.parametrize("layer", [1, UNKNOWN])
def test_surface_of_an_unknown_layer_is_that_of_its_scan(layer: int) -> None:
    """As far as noisy ground shows the datum of the scan."""
    job, _, estimate, height = printed_with_an_unknown_layer(layer)
    error = (estimate.height - height)[job.mask]
    assert np.std(error) < 1.2 * NOISE
    assert abs(error.mean()) < 0.8 * NOISE
    exact, _, estimate, height = printed_with_an_unknown_layer(layer, noise=0.0)
    np.testing.assert_allclose(estimate.height[exact.mask], height[exact.mask], rtol=0.0, atol=1e-8)


def test_cell_of_an_unknown_layer_that_was_not_seen_may_be_anything_between_nothing_and_all() -> None:
    job = block()
    estimator, whole = HeightEstimator(job, adapt_ink="off"), job.mask.astype(np.int32)
    flat, seen = np.zeros(job.mask.shape), np.ones(job.mask.shape, np.bool_)
    start = estimator.first(flat, seen)
    full = LayerModel.of(job).layer(flat, whole, 1)
    estimate = estimator.next(start, whole, 1, flat, ~seen, is_unknown=True)
    np.testing.assert_allclose(estimate.height[job.mask], 0.5 * full[job.mask])
    np.testing.assert_allclose(np.sqrt(12.0 * estimate.height_variance[job.mask]), full[job.mask], rtol=1e-6)


def test_controller_plans_on_from_the_scan_of_an_unknown_layer() -> None:
    """Layer 1 lacks a third: from a layer that is known the controller would conclude that the ink is weak."""
    job = block(16, 16)

    def answered(is_unknown: bool) -> Any:
        controller = LayerMpcController(job, horizon=1)
        assert isinstance(controller, LayerController)
        controller.initialize(0, inputs_of(job, np.zeros(job.mask.shape), 0))
        first = controller.do_step(0, 1, inputs_of(job, np.zeros(job.mask.shape), 0))
        surface = LayerModel.of(job).scaled(0.67).layer(np.zeros(job.mask.shape), first["pattern"], 1)
        inputs = inputs_of(job, surface, 1) | {"layer_unknown": np.asarray(is_unknown)}
        return controller.do_step(1, 1, inputs)

    unknown, known = answered(is_unknown=True), answered(is_unknown=False)
    assert unknown["layer_command"] == known["layer_command"] == 2
    np.testing.assert_allclose(unknown["estimated_height"], known["estimated_height"], atol=1e-8)
    assert (float(unknown["volume_scale"]), float(known["volume_scale"])) == (1.0, pytest.approx(0.67, abs=0.1))


@pytest.mark.parametrize(
    ("scan", "error"),
    [
        (
            np.full((10, 9), 30.0),
            "measured_height is 30 at cell (0, 0), which is marked valid; needs a height in metres",
        ),
        (np.where(np.eye(10, 9, 3), -0.5, 0.0), "measured_height is -0.5 at cell (0, 3), which is marked valid"),
        (np.where(np.eye(10, 9, 3), np.nan, 0.0), "measured_height is nan at cell (0, 3), which is marked valid"),
        (np.zeros((9, 10)), "measured_height has shape (9, 10); needs (10, 9)"),
        (np.zeros((10, 9)).tolist(), "measured_height is a list; needs an array of float64"),
        (np.zeros((10, 9), np.float32), "measured_height has dtype float32; needs float64"),
    ],
)
def test_scan_that_is_no_surface_in_metres_is_refused(scan: Any, error: str) -> None:
    job = block(10, 9)
    seen, estimator = np.ones((10, 9), np.bool_), HeightEstimator(job)
    known = estimator.first(np.zeros((10, 9)), seen)
    for read in (
        lambda: estimator.first(scan, seen),
        lambda: estimator.next(known, 0 * seen.astype("i4"), 1, scan, seen),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(error)}"):
            read()


def test_readings_that_are_not_valid_may_be_anything() -> None:
    seen = ~np.eye(10, 9, 3, dtype=np.bool_)
    for nothing in (np.nan, 30.0, -np.inf):
        found = HeightEstimator(block(10, 9)).first(np.where(seen, 0.0, nothing), seen)
        np.testing.assert_array_equal(found.height, 0.0)


@pytest.mark.parametrize(
    ("pattern", "factor", "error"),
    [
        (2, None, "pattern holds 0 to 2; needs 0 to 1, the inks given"),
        (-1, None, "pattern holds -1 to 0; needs 0 to 1, the inks given"),
        (1, -0.1, "factor holds -0.1; needs volumes of droplets, 0 and more"),
    ],
)
def test_droplets_of_no_ink_and_of_no_volume_are_refused(pattern: int, factor: float | None, error: str) -> None:
    job = block(10, 9)
    estimator, flat, seen = HeightEstimator(job), np.zeros((10, 9)), np.ones((10, 9), np.bool_)
    layer, volumes = pattern * job.mask.astype(np.int32), None if factor is None else np.full((10, 9), factor)
    for use in (
        lambda: estimator.next(estimator.first(flat, seen), layer, 1, flat, seen, volumes),
        lambda: LayerModel.of(job).layer(flat, layer, 1, volumes),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(error)}$"):
            use()

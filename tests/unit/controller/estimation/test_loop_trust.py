"""When a loop is not trusted: ground, residuals, and scans that miss most of the part."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.estimation.ink_identification import InkModel, ink_table
from inkloop_controller.estimation.loop_trust import LoopTrust, UntrustedReason
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import SECOND, block, inputs_of
from support.long_proofs import rest_is_long
from support.numpy import estimator_numpy

JOB = block(20, 18, height=60e-6)
SHAPE = (JOB.nx, JOB.ny)
SEEN = np.ones(SHAPE, np.bool_)
ROW, COLUMN = np.indices(SHAPE)


def first(scan: Any, layer: int = 0, valid: Any = SEEN, **options: Any) -> LoopTrust:
    return HeightEstimator(JOB, **options).first(scan, valid, layer).trust


@pytest.mark.parametrize(
    ("scan", "is_wrong"),
    [
        (np.zeros(SHAPE), False),
        (np.full(SHAPE, 5e-6), True),
        (np.full(SHAPE, -5e-6), True),
        (0.6e-6 * (ROW - 9.5), True),
        (-0.7e-6 * (COLUMN - 8.5), True),
        (np.full(SHAPE, 2e-6), False),
        (np.random.default_rng(1).normal(0.0, 3e-6, SHAPE), False),
    ],
)
def test_ground_that_is_not_the_flat_one_is_found_in_the_first_scan(scan: Any, is_wrong: bool) -> None:
    trust = first(scan)
    terms = np.stack([np.ones(SHAPE), ROW / 19 - 0.5, COLUMN / 17 - 0.5], axis=-1).reshape(-1, 3)
    plane = np.linalg.lstsq(terms, scan.ravel(), rcond=None)[0]
    found = (trust.ground_offset, trust.ground_rise_x, trust.ground_rise_y)
    np.testing.assert_allclose(found, plane, rtol=1e-9, atol=1e-18)
    assert trust.reasons == (UntrustedReason.GROUND if is_wrong else UntrustedReason(0))


def test_plane_that_noise_shows_by_chance_is_no_ground() -> None:
    trust = first(np.random.default_rng(1).normal(0.0, 60e-6, SHAPE))
    assert abs(trust.ground_offset) + 0.5 * abs(trust.ground_rise_x) + 0.5 * abs(trust.ground_rise_y) > 5e-6
    assert not trust.reasons & UntrustedReason.GROUND


def test_ground_counts_on_layer_0_and_where_it_is_called_flat_only() -> None:
    high = np.full(SHAPE, 5e-6)
    assert not any(first(high, layer=layer).reasons for layer in (1, 41))
    assert not first(high, flat_ground=False).reasons
    assert not first(high, take_as_read=True).reasons


def test_scan_that_misses_most_of_the_part_is_a_reason() -> None:
    for lost, expected in ((0.4, UntrustedReason(0)), (0.6, UntrustedReason.BLIND)):
        valid = SEEN.copy()
        cells = np.argwhere(JOB.mask)
        valid[tuple(cells[: round(lost * len(cells))].T)] = False
        trust = first(np.zeros(SHAPE), valid=valid)
        assert trust.blind_share == pytest.approx(lost, abs=0.01)
        assert trust.reasons == expected


def squares_of_flat_layer() -> Any:
    """Sum over the droplets of a full layer of the squares of what each adds to a cell [m^2]."""
    padded = np.pad(JOB.mask.astype(float), 1)
    shares = {0: 4.4e-6**2, 1: 0.6e-6**2, 2: 0.2e-6**2}
    near = ((di, dj) for di in (-1, 0, 1) for dj in (-1, 0, 1))
    return sum(
        shares[abs(di) + abs(dj)] * padded[1 + di : 1 + di + SHAPE[0], 1 + dj : 1 + dj + SHAPE[1]] for di, dj in near
    )


def test_residuals_are_medians_of_what_a_common_volume_does_not_explain() -> None:
    rng, pattern = np.random.default_rng(2), JOB.mask.astype(np.int32)
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    expected = LayerModel.of(JOB).layer(np.zeros(SHAPE), pattern, 1)
    scan = 0.7 * expected + JOB.mask * rng.normal(0.0, 2e-6, SHAPE)
    trust = estimator.next(estimator.first(np.zeros(SHAPE), SEEN), pattern, 1, scan, SEEN).trust
    growth, added, variance = scan[JOB.mask], expected[JOB.mask], 0.01 * squares_of_flat_layer()[JOB.mask]
    volume = np.median(growth / added)
    found = np.median((growth - volume * added) ** 2 / variance) / 0.4549
    assert trust.early == pytest.approx(found, rel=1e-9, abs=0.0)
    assert trust.residual == pytest.approx(0.8 + 0.2 * found, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("adapt_ink", ["off", "scale"])
def test_numbers_of_a_print_are_those_of_its_numpy_statement(adapt_ink: InkModel) -> None:
    """Exact scans of layers that are dense, sparse, hardly there, or of ink that runs out, past half of the height."""
    rng, estimator = np.random.default_rng(8), HeightEstimator(JOB, adapt_ink=adapt_ink, sensor_noise_std=0.0)
    stated, surface, usual = estimator_numpy.Estimator(JOB, 0.0, adapt_ink), np.zeros(SHAPE), 1.0
    state = stated.first(surface, SEEN)
    residual, spill, reckoned = 1.0, 1.0, surface
    early: list[float] = []
    estimate = estimator.first(surface, SEEN)
    dense, weak = (0.9, 0.3, 0.8, 0.02, 1.0, 1.0, 1.0, 0.7, 0.4), (0.9, 0.8, 0.4, 1.0, 1.1, 0.9, 0.9, 0.8, 1.0)
    for layer, (share, volume) in enumerate(zip(dense, weak, strict=True), start=1):
        pattern = (JOB.mask & (rng.random(SHAPE) < share)).astype(np.int32)
        added, is_early = stated.printed(surface, pattern, stated.nominal) - surface, surface[JOB.mask].mean() < 30e-6
        growth = volume * added * rng.uniform(0.9, 1.1, SHAPE)
        state = stated.next(state, pattern, surface + growth, SEEN)
        ink, learnt = state.inks, float(np.sum(state.inks @ [1.0, 4.0, 4.0]) / stated.full)
        added = stated.printed(surface, pattern, ink) - surface
        hit = (pattern > 0) & (added > 0.0)
        volume, enough = usual / learnt, hit.sum() >= 20
        if enough:
            middle = float(np.median(growth[hit] / added[hit]))
            rest = growth[hit] - middle * added[hit]
            found = float(np.median(rest**2 / state.spread[hit])) / 0.4549
            spilt = JOB.mask & (pattern == 0) & (added > 0.0)
            if spilt.sum() >= 20:
                wrong = (growth - middle * added)[spilt] ** 2
                spill = 0.8 * spill + 0.2 * float(np.median(wrong)) / 0.4549 / float(state.spread[spilt].mean())
            residual, early = 0.8 * residual + 0.2 * found, early + [found] * int(is_early)
            if hit.sum() > 0.5 * JOB.mask.sum():
                volume = middle
                usual = 0.8 * usual + 0.2 * middle * learnt if middle > 0.5 else usual
        reckoned = reckoned + volume * (stated.printed(reckoned, pattern, ink) - reckoned)
        surface = surface + growth
        estimate = estimator.next(estimate, pattern, layer, surface, SEEN)
        trust = estimate.trust
        shown = (trust.residual, trust.early, trust.volume, trust.usual, trust.surprise, trust.spill)
        expected = (residual, float(np.mean(early)), volume, usual, residual**0.5, spill)
        assert shown == pytest.approx(expected, rel=1e-9, abs=0.0), layer
        np.testing.assert_allclose(estimate.reckoned, reckoned, rtol=0.0, atol=1e-15)
    assert 2 < len(early) < trust.layers == 8
    assert spill != 1.0


@pytest.mark.parametrize(
    ("real", "variation", "is_foreign"),
    [
        (Ink(), 0.2, False),
        (Ink(), 0.4, False),
        (Ink(5.5e-6, 0.75e-6, 0.25e-6), 0.2, False),
        (Ink(3.2e-6, 0.9e-6, 0.2e-6), 0.2, True),
        (Ink(6.0e-6, 0.4e-6, 0.0), 0.2, True),
    ],
)
def test_droplets_of_another_shape_make_a_foreign_plant_and_varying_volumes_do_not(
    real: Ink, variation: float, is_foreign: bool
) -> None:
    rng, estimator, plant = np.random.default_rng(3), HeightEstimator(JOB), LayerModel((real,))
    surface, estimate = np.zeros(SHAPE), estimator.first(np.zeros(SHAPE), SEEN)
    assert not estimate.trust.is_plant_foreign
    for layer in range(1, 6):
        pattern = (JOB.mask & (rng.random(SHAPE) < 0.7)).astype(np.int32)
        surface = plant.layer(surface, pattern, layer, rng.uniform(1.0 - variation, 1.0, SHAPE))
        estimate = estimator.next(estimate, pattern, layer, surface, SEEN)
    assert estimate.trust.is_plant_foreign is is_foreign


def trust_after_trials(trials: bool, disturbed: bool) -> LoopTrust:
    """Of the layer after four dead nozzles were found, in which they may be tried; its scan near them is another one
    where it is disturbed."""
    rng, model = np.random.default_rng(7), LayerModel.of(JOB)
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    dead, near = np.zeros(SHAPE, np.bool_), np.zeros(SHAPE, np.bool_)
    for row, column in ((6, 5), (6, 12), (13, 5), (13, 12)):
        dead[row, column] = near[row - 1 : row + 2, column - 1 : column + 2] = True
    surface = np.zeros(SHAPE)
    estimate = estimator.first(surface, SEEN)
    for layer in range(1, 6):
        pattern = (JOB.mask & (rng.random(SHAPE) < 0.7)).astype(np.int32)
        pattern[dead] = layer < 5 or trials
        growth = model.layer(surface, np.where(dead, 0, pattern), layer) - surface
        surface = surface + growth * rng.uniform(0.9, 1.1, SHAPE)
        if layer == 5:
            np.testing.assert_array_equal(estimate.dead, dead)
            surface = surface + near * disturbed * rng.normal(0.0, 3e-6, SHAPE)
        estimate = estimator.next(estimate, pattern, layer, surface, SEEN)
    return estimate.trust


def test_trials_of_dead_nozzles_tell_nothing_of_droplets() -> None:
    def told(trust: LoopTrust) -> tuple[float, ...]:
        return trust.residual, trust.early, trust.volume, trust.spill

    assert told(trust_after_trials(trials=True, disturbed=True)) == told(trust_after_trials(True, disturbed=False))
    assert told(trust_after_trials(trials=False, disturbed=True)) != told(trust_after_trials(False, disturbed=False))


def test_trust_of_earlier_versions_is_restored() -> None:
    trust = LoopTrust.full()
    assert LoopTrust.of_sums(trust.sums()[:-1]) == trust
    with pytest.raises(ValueError, match=r"zip\(\)"):
        LoopTrust.of_sums(trust.sums()[:-2])


def test_misfit_of_droplets_counts_until_the_part_is_half_built() -> None:
    """A layer is 7.6 um of 60: the fifth one begins above half."""
    rng, pattern, plant = np.random.default_rng(2), JOB.mask.astype(np.int32), LayerModel.of(JOB)
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    height, found = np.zeros(SHAPE), []
    estimate = estimator.first(height, SEEN)
    for layer in range(1, 8):
        height = plant.layer(height, pattern, layer) + JOB.mask * rng.normal(0.0, 2e-6, SHAPE)
        estimate = estimator.next(estimate, pattern, layer, height, SEEN)
        found.append(estimate.trust.early)
    counted = int((np.diff(found) != 0.0).sum()) + 1
    assert counted in (4, 5)
    assert found[0] > 4.0
    assert len(set(found[counted - 1 :])) == 1


@pytest.mark.parametrize(
    ("scatter", "expected"),
    [(0.5e-6, lambda trust: 0.1 * (trust.residual * 0.4549 / 0.75) ** 0.5),  # as droplets that vary
     (1.1e-6, lambda trust: 0.1 * trust.early**0.5),  # more than droplets
     (3e-6, lambda _: 0.3)],
)  # fmt: skip
def test_scatter_beyond_that_of_droplets_is_the_deviation_of_the_plant(
    scatter: float, expected: Callable[[LoopTrust], float]
) -> None:
    rng, pattern = np.random.default_rng(2), JOB.mask.astype(np.int32)
    estimator = HeightEstimator(JOB, adapt_ink="off", sensor_noise_std=0.0, register_scans=False)
    scan = LayerModel.of(JOB).layer(np.zeros(SHAPE), pattern, 1) + JOB.mask * rng.normal(0.0, scatter, SHAPE)
    trust = estimator.next(estimator.first(np.zeros(SHAPE), SEEN), pattern, 1, scan, SEEN).trust
    assert trust.droplet_std == pytest.approx(expected(trust), rel=1e-9, abs=0.0)


def prints(seed: int, variation: float, noise: float, surprise: float = 0.0) -> set[UntrustedReason]:
    """The reasons of all layers of a print; surprise: what a layer adds at random that no droplet explains [m]."""
    controller, plant = LayerMpcController(JOB, horizon=2, annealing_sweeps=0), LayerModel.of(JOB)
    rng, height, reasons = np.random.default_rng(seed), np.zeros(SHAPE), set()
    controller.initialize(0, inputs_of(JOB, height, 0))
    for layer in range(25):
        scan = height + noise * rng.standard_normal(SHAPE)
        outputs = controller.do_step(layer * SECOND, SECOND, inputs_of(JOB, scan, layer))
        reasons.add(UntrustedReason(int(outputs["untrusted_reasons"])))
        height = plant.layer(height, outputs["pattern"], layer + 1, 1.0 - variation * rng.random(SHAPE))
        height += surprise * JOB.mask * rng.standard_normal(SHAPE)
    return reasons


@pytest.mark.parametrize("seed", rest_is_long(range(50), 4))
def test_prints_without_errors_are_trusted(seed: int) -> None:
    assert prints(seed, (0.2, 0.4)[seed % 2], (0.0, 1e-6)[seed // 2 % 2]) == {UntrustedReason(0)}


def test_printer_that_no_droplet_model_explains_is_not_trusted() -> None:
    assert any(reason & UntrustedReason.RESIDUALS for reason in prints(1, 0.2, 0.0, surprise=2.5e-6))


def learnt(adapt_ink: InkModel, real: Ink, spill: float) -> Estimate:
    """After layers of random patterns by ink `real`; spill: share of what they add that smears over the whole grid."""
    estimator = HeightEstimator(JOB, adapt_ink=adapt_ink, sensor_noise_std=0.0, register_scans=False)
    plant, rng = LayerModel.of(block(20, 18, height=60e-6, inks=(real,))), np.random.default_rng(3)
    height = np.zeros(SHAPE)
    estimate = estimator.first(height, SEEN)
    for layer in range(1, 9):
        pattern = np.where(JOB.mask, rng.random(SHAPE) < 0.6, False).astype(np.int32)
        added = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(SHAPE)) - height
        height = height + (1.0 - spill) * added + spill * rng.permuted(added)
        estimate = estimator.next(estimate, pattern, layer, height, SEEN)
    return estimate


def test_three_heights_are_taken_where_they_predict_better_than_the_volume() -> None:
    real = Ink(2.8e-6, 0.9e-6, 0.3e-6)
    full, volumes = learnt("full", real, 0.0), learnt("scale", real, 0.0)
    assert full.learnt.errors[0] < full.learnt.errors[1]
    assert full.inks[0].h2 / full.inks[0].h1 > 1.5 * volumes.inks[0].h2 / volumes.inks[0].h1


def test_three_heights_that_predict_no_better_give_way_to_the_volume() -> None:
    full, volumes = (learnt(model, Ink(), 0.3) for model in ("full", "scale"))
    assert full.learnt.errors[0] > full.learnt.errors[1]
    np.testing.assert_allclose(ink_table(full.inks), ink_table(volumes.inks), rtol=1e-14, atol=0.0)
    np.testing.assert_allclose(full.height, volumes.height, rtol=1e-13, atol=0.0)

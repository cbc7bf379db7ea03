"""Scans that do not show what was printed stop the print, with the right reason; others do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scipy import ndimage

from inkloop.component import Ink, Job
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.estimate_figures import TRANSFORMS, UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.model import LayerModel
from support.closed_loop import SECOND, block, inputs_of
from support.long_proofs import rest_is_long

JOB = block(20, 18, height=60e-6)
SHAPE = (JOB.nx, JOB.ny)
SEEN = np.ones(SHAPE, np.bool_)
NONE = UntrustedReason(0)
WITHIN = 3  # layers


def hook(nx: int = 22, ny: int = 22) -> Job:
    """A part that is none of its own mirrored or turned images."""
    mask = np.zeros((nx, ny), np.bool_)
    mask[3:-3, 4:8] = True
    mask[3:7, 4:-6] = True
    mask[10:13, 8:12] = True
    return Job(nx, ny, 263.256e-6, np.where(mask, 80e-6, 0.0), mask)


Show = Callable[[list[Any]], Any]
"""The scan shown, by all scans so far."""


@dataclass(frozen=True)
class Lie:
    """The scan shown, and its transform; begins: the first layer whose scan is wrong."""

    show: Show
    reason: UntrustedReason
    begins: int = 1
    transform: str = ""


STUCK = UntrustedReason.NO_GROWTH | UntrustedReason.SAME_SCAN  # exact scans do not say which
LIES = {
    "frozen": Lie(lambda scans: scans[min(len(scans) - 1, 4)], STUCK, 5),
    "zero": Lie(lambda scans: 0.0 * scans[-1], STUCK),
    "one layer late": Lie(lambda scans: scans[max(len(scans) - 2, 0)], UntrustedReason.LATE),
    "mirrored in x": Lie(lambda scans: scans[-1][::-1], UntrustedReason.TURNED, transform="mirrored in x"),
    "mirrored in y": Lie(lambda scans: scans[-1][:, ::-1], UntrustedReason.TURNED, transform="mirrored in y"),
    "turned by 180": Lie(
        lambda scans: np.rot90(scans[-1], 2), UntrustedReason.TURNED, transform="turned by 180 degrees"
    ),
    "transposed": Lie(lambda scans: scans[-1].T, UntrustedReason.TURNED, transform="transposed"),
    "turned by 90": Lie(
        lambda scans: np.rot90(scans[-1], 1), UntrustedReason.TURNED, transform="turned by 270 degrees"
    ),
    "turned by 270": Lie(
        lambda scans: np.rot90(scans[-1], 3), UntrustedReason.TURNED, transform="turned by 90 degrees"
    ),
    "transposed and turned": Lie(
        lambda scans: np.rot90(scans[-1], 2).T, UntrustedReason.TURNED, transform="transposed and turned by 180 degrees"
    ),
}


def shown(job: Job, show: Show, layers: int, noise: float = 0.0, seed: int = 0, **options: Any) -> list[Estimate]:
    """The estimates after scans 0, 1, ... of layers of random patterns, whose droplets vary by 20 %."""
    rng, plant, estimator = np.random.default_rng(seed), LayerModel.of(job), HeightEstimator(job, **options)
    seen, height = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)
    scans = [height + noise * rng.standard_normal(height.shape)]
    found = [estimator.first(np.ascontiguousarray(show(scans)), seen)]
    for layer in range(1, layers + 1):
        pattern = (job.mask & (rng.random(job.mask.shape) < 0.8)).astype(np.int32)
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(job.mask.shape))
        scans.append(height + noise * rng.standard_normal(height.shape))
        found.append(estimator.next(found[-1], pattern, layer, np.ascontiguousarray(show(scans)), seen))
    return found


def as_it_is(scans: list[Any]) -> Any:
    return scans[-1]


@pytest.mark.parametrize("noise", [0.0, 0.3e-6])
@pytest.mark.parametrize("name", LIES)
def test_scans_that_lie_stop_the_print_within_three_layers_with_their_reason(name: str, noise: float) -> None:
    lie = LIES[name]
    has_sides_exchanged = name.startswith(("transposed", "turned by 90", "turned by 270"))
    job = hook() if has_sides_exchanged else hook(24, 20) if noise else hook(20, 24)
    estimates = shown(job, lie.show, lie.begins + 5, noise)
    layer = next(k for k, each in enumerate(estimates) if each.figures.stop)
    figures = estimates[layer].figures
    assert lie.begins < layer <= lie.begins + WITHIN
    of_frozen = UntrustedReason.SAME_SCAN if noise else UntrustedReason.NO_GROWTH
    assert figures.stop in (of_frozen if name == "frozen" else lie.reason)
    assert figures.reasons & figures.stop
    assert figures.stop_layer == layer
    assert figures.stop_figure > 1.5
    if lie.transform:
        assert TRANSFORMS[figures.transform] == lie.transform
    assert bool(figures.transform) == (figures.stop == UntrustedReason.TURNED)
    assert estimates[-1].figures.stop == figures.stop


@pytest.mark.parametrize("name", ["frozen", "zero", "mirrored in x", "turned by 180"])
def test_scan_that_lies_changes_no_map(name: str) -> None:
    """Cells live on the prediction of full layers instead."""
    lie, job = LIES[name], hook()
    estimates, honest = (shown(job, show, lie.begins + 2) for show in (lie.show, as_it_is))
    for one, other in zip(estimates[lie.begins :], honest[lie.begins :], strict=True):
        grown = (one.height - estimates[0].height)[job.mask].mean()
        assert grown == pytest.approx(other.height[job.mask].mean(), rel=0.15, abs=0.0)


def test_single_scan_that_lies_stops_nothing() -> None:
    def once(scans: list[Any]) -> Any:
        return scans[-2] if len(scans) == 6 else scans[-1]

    estimates = shown(hook(), once, 9)
    assert not any(each.figures.stop for each in estimates)
    assert not estimates[-1].figures.reasons


@pytest.mark.parametrize("noise", [0.0, 1e-6])
@pytest.mark.parametrize("seed", range(3))
def test_scans_that_are_true_are_not_doubted(seed: int, noise: float) -> None:
    for job in (JOB, hook()):
        assert not any(each.figures.reasons for each in shown(job, as_it_is, 8, noise, seed))


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize("seed", range(4))
def test_last_droplets_are_no_repeated_scan_where_the_map_cannot_hold_what_is_read(seed: int, along: str) -> None:
    """Half a cell off, readings are means of two cells: no map has readings that alternate."""
    job = hook(20, 24) if along == "x" else hook(24, 20)
    rng, plant, estimator = np.random.default_rng(seed), LayerModel.of(job), HeightEstimator(job)
    seen, height = np.ones(job.mask.shape, np.bool_), np.zeros(job.mask.shape)
    estimate = estimator.first(height, seen)
    shift, axis = ((0.5, -0.25), 0) if along == "x" else ((0.25, -0.5), 1)
    for layer in range(1, 14):
        pattern = (job.mask & (rng.random(job.mask.shape) < (0.8 if layer < 6 else 0.01))).astype(np.int32)
        height = plant.layer(height, pattern, layer, 1.0 - 0.2 * rng.random(job.mask.shape))
        scan = ndimage.shift(height, shift, order=1, mode="nearest")
        if layer > 4:
            scan += np.where(job.mask, 0.4e-6 * (-1.0) ** np.indices(job.mask.shape)[axis], 0.0)
        estimate = estimator.next(estimate, pattern, layer, scan, seen)
        assert not estimate.figures.stop


@pytest.mark.parametrize(("droplets", "stops"), [(1, False), (4, False), (19, False), (20, True)])
def test_few_droplets_that_fail_are_no_dry_head(droplets: int, stops: bool) -> None:
    """Dead nozzles may be asked alone in the last layers, again and again."""
    job, rng = JOB, np.random.default_rng(4)
    estimator, plant, height = HeightEstimator(job, sensor_noise_std=0.3e-6), LayerModel.of(job), np.zeros(SHAPE)
    estimate = estimator.first(height + rng.normal(0.0, 0.3e-6, SHAPE), SEEN)
    few = np.zeros(SHAPE, np.int32)
    few[tuple(np.argwhere(job.mask)[3 : 3 + droplets].T)] = 1
    for layer in range(1, 10):
        pattern = few if layer > 5 else job.mask.astype(np.int32)
        volume = 1e-9 if layer > 5 else 1.0 - 0.2 * rng.random(SHAPE)
        height = plant.layer(height, pattern, layer, np.broadcast_to(volume, SHAPE))
        estimate = estimator.next(estimate, pattern, layer, height + rng.normal(0.0, 0.3e-6, SHAPE), SEEN)
    assert bool(estimate.figures.stop) == stops


def test_head_that_runs_dry_shows_no_growth() -> None:
    job, rng = JOB, np.random.default_rng(3)
    estimator, plant, height = HeightEstimator(job), LayerModel.of(job), np.zeros(SHAPE)
    estimate = estimator.first(height + rng.normal(0.0, 0.3e-6, SHAPE), SEEN)
    for layer in range(1, 12):
        pattern = job.mask.astype(np.int32)
        height = plant.layer(height, pattern, layer) if layer < 6 else height
        estimate = estimator.next(estimate, pattern, layer, height + rng.normal(0.0, 0.3e-6, SHAPE), SEEN)
    assert estimate.figures.stop == UntrustedReason.NO_GROWTH
    assert 7 <= estimate.figures.stop_layer <= 6 + WITHIN
    assert not estimate.dead.any()


def test_trust_again_lets_the_print_go_on_from_the_next_scan_as_it_is() -> None:
    job = JOB
    estimator, plant, pattern = HeightEstimator(job), LayerModel.of(job), job.mask.astype(np.int32)
    height = np.zeros(SHAPE)
    estimate = estimator.first(height, SEEN)
    for layer in range(1, 8):
        height = plant.layer(height, pattern, layer) if layer < 4 else height
        estimate = estimator.next(estimate, pattern, layer, height, SEEN)
    assert estimate.figures.stop
    before = {name: value.copy() for name, value in estimate.state.items()}
    again = estimator.trust_again(estimate)
    assert not again.figures.stop
    for name, value in estimate.state.items():
        np.testing.assert_array_equal(value, before[name])
    for layer in range(8, 11):
        height = plant.layer(height, pattern, layer)
        again = estimator.next(again, pattern, layer, height, SEEN)
        assert not again.figures.stop
        np.testing.assert_allclose(again.height[job.mask], height[job.mask], rtol=0.0, atol=0.2e-6)


def test_nothing_of_a_stop_is_left_once_a_person_has_looked() -> None:
    lie, job = LIES["mirrored in x"], hook()
    stopped = shown(job, lie.show, lie.begins + WITHIN)[-1]
    found = HeightEstimator(job).trust_again(stopped).figures
    assert (stopped.figures.transform, stopped.figures.stop_layer > 0) == (2, True)
    assert (found.stop, found.stop_layer, found.transform, found.stop_figure) == (NONE, 0, 0, 0.0)


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
    assert not estimate.figures.is_foreign
    for layer in range(1, 6):
        pattern = (JOB.mask & (rng.random(SHAPE) < 0.7)).astype(np.int32)
        surface = plant.layer(surface, pattern, layer, rng.uniform(1.0 - variation, 1.0, SHAPE))
        estimate = estimator.next(estimate, pattern, layer, surface, SEEN)
    assert estimate.figures.is_foreign is is_foreign


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
    assert prints(seed, (0.2, 0.4)[seed % 2], (0.0, 1e-6)[seed // 2 % 2]) == {NONE}


@pytest.mark.parametrize(("surprise", "is_told"), [(1.0e-6, False), (1.5e-6, False), (2.0e-6, True), (2.5e-6, True)])
def test_printer_that_no_droplet_model_explains_is_not_trusted(surprise: float, is_told: bool) -> None:
    """From three standard deviations on: the surprises here end at 2.0, 2.7, 3.6 and 4.2 of them."""
    assert any(reason & UntrustedReason.RESIDUALS for reason in prints(1, 0.2, 0.0, surprise)) == is_told

"""What the layers of a print show about the ink, and what is not caused by the ink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator
from inkloop_controller.estimation.ink_identification import InkModel
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import block

OTHER = Ink(3.7e-6, 0.75e-6, 0.15e-6)


class Bench:
    """A job printed with other ink than the nominal one, on a rough substrate, scanned with noise."""

    def __init__(self, job: Job, inks: tuple[Ink, ...], model: InkModel, noise_std: float = 0.0, seed: int = 0) -> None:
        self.job, self.noise_std, self.rng = job, noise_std, np.random.default_rng(seed)
        self.plant = LayerModel(inks, job.passes)
        self.estimator = HeightEstimator(job, adapt_ink=model, sensor_noise_std=noise_std)
        self.seen = np.ones(job.mask.shape, np.bool_)
        self.height = np.where(job.mask, self.rng.uniform(0.0, 8e-6, job.mask.shape), 0.0)
        self.estimate = self.estimator.first(self.scan(), self.seen)
        self.layers = 0

    def scan(self) -> Any:
        return self.height + self.rng.normal(0.0, self.noise_std, self.height.shape)

    def print(self, pattern: Any, factor: Any = None, drift: Any = 0.0) -> Estimate:
        self.layers += 1
        self.height = self.plant.layer(self.height, pattern, self.layers, factor)
        scan = self.scan() + drift
        self.estimate = self.estimator.next(self.estimate, pattern, self.layers, scan, self.seen)
        return self.estimate

    def random_pattern(self) -> Any:
        drawn = 1 + self.rng.integers(0, len(self.job.inks), self.job.mask.shape)
        return np.where(self.job.mask & (self.rng.random(self.job.mask.shape) < 0.5), drawn, 0).astype(np.int32)

    def full_pattern(self) -> Any:
        return self.job.mask.astype(np.int32)


def shares(found: Ink, true: Ink) -> list[float]:
    return [found.h1 / true.h1, found.h2 / true.h2, found.h3 / true.h3]


def scaled(volume: float) -> Ink:
    return Ink(*(volume * value for value in (Ink().h1, Ink().h2, Ink().h3)))


@pytest.mark.parametrize("volume", [0.5, 0.8, 0.9, 1.2])
@pytest.mark.parametrize("passes", [1, 4])
def test_volume_is_known_after_a_full_layer(volume: float, passes: int) -> None:
    bench = Bench(block(20, 20, passes=passes), (scaled(volume),), "scale")
    assert bench.print(bench.full_pattern()).ink_scale == pytest.approx(volume, rel=5e-3, abs=0.0)
    for _ in range(5):
        bench.print(bench.full_pattern())
    assert bench.estimate.ink_scale == pytest.approx(volume, rel=1e-3, abs=0.0)


@pytest.mark.parametrize(("volume", "learnt"), [(0.05, 0.25), (7.0, 4.0)])
@pytest.mark.parametrize("model", ["scale", "full"])
def test_volume_that_is_something_else_than_ink_is_learnt_as_far_as_ink_goes(
    model: InkModel, volume: float, learnt: float
) -> None:
    bench = Bench(block(12, 12), (scaled(volume),), model)
    for _ in range(3):
        bench.print(bench.full_pattern())
    assert bench.estimate.ink_scale == pytest.approx(learnt, rel=1e-9, abs=0.0)


def test_three_heights_that_a_random_layer_separates_are_used_once_they_have_predicted_the_next() -> None:
    bench = Bench(block(44, 44), (OTHER,), "full", noise_std=0.3e-6)
    first, nominal = bench.print(bench.random_pattern()).inks[0], Ink()
    assert first.h2 / first.h1 == pytest.approx(nominal.h2 / nominal.h1, rel=1e-9, abs=0.0)
    found = shares(bench.print(bench.random_pattern()).inks[0], OTHER)
    assert found[0] == pytest.approx(1.0, abs=0.02)
    assert found[1] == pytest.approx(1.0, abs=0.03)
    assert found[2] == pytest.approx(1.0, abs=0.10)


def test_noise_of_a_micrometre_biases_the_three_heights_little() -> None:
    """Least squares without instruments is off by -6 % in h1 and +39 % in h3."""
    found = []
    for seed in range(10):
        bench = Bench(block(24, 24), (OTHER,), "full", noise_std=1e-6, seed=seed)
        for _ in range(10):
            bench.print(bench.random_pattern())
        found.append(shares(bench.estimate.inks[0], OTHER))
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) - 1.0), [0.02, 0.02, 0.12])


@pytest.mark.parametrize("model", ["scale", "full"])
def test_each_of_two_inks_is_learnt_separately(model: InkModel) -> None:
    nominal = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
    true = (scaled(0.85), Ink(1.1 * 3.9e-6, 1.1 * 0.55e-6, 1.1 * 0.15e-6))
    bench = Bench(block(44, 44, inks=nominal), true, model)
    for _ in range(3):
        bench.print(bench.random_pattern())
    for found, ink in zip(bench.estimate.inks, true, strict=True):
        assert found.layer_height == pytest.approx(ink.layer_height, rel=0.01, abs=0.0)


def test_full_flat_layers_leave_the_proportion_as_it_is() -> None:
    """Away from edges they show h1 + 4 h2 + 4 h3 alone."""
    job = block(30, 30)
    bench = Bench(job, (scaled(0.8),), "full")
    bench.height[:] = 0.0
    bench.estimate = bench.estimator.first(bench.height, bench.seen)
    bench.seen[:4], bench.seen[-4:], bench.seen[:, :4], bench.seen[:, -4:] = False, False, False, False
    found = shares(bench.print(bench.full_pattern()).inks[0], scaled(0.8))
    nominal = Ink()
    volume = np.dot(found, [nominal.h1, 4.0 * nominal.h2, 4.0 * nominal.h3]) / nominal.layer_height
    assert volume == pytest.approx(1.0, abs=0.01)
    assert found[1] == pytest.approx(found[2], rel=0.2, abs=0.0)


@pytest.mark.parametrize("model", ["scale", "full"])
def test_dead_nozzles_lower_no_volume(model: InkModel) -> None:
    bench = Bench(block(34, 34), (scaled(0.9),), model)
    factor = np.ones(bench.height.shape)
    factor[:, [9, 21]] = 1e-9
    for _ in range(10):
        bench.print(bench.full_pattern() if model == "scale" else bench.random_pattern(), factor)
    assert bench.estimate.ink_scale == pytest.approx(0.9, rel=0.01, abs=0.0)


def test_layer_of_dead_nozzles_alone_gives_no_information() -> None:
    bench = Bench(block(34, 34), (scaled(0.9),), "scale")
    bench.print(bench.full_pattern())
    before = bench.estimate.ink_scale
    factor = np.full(bench.height.shape, 1e-9)
    pattern = np.zeros(bench.height.shape, np.int32)
    pattern[4:30, 9] = 1
    for _ in range(10):
        bench.print(pattern, factor)
    assert bench.estimate.ink_scale == pytest.approx(before, abs=2e-3)


def test_drift_and_tilt_of_the_sensor_are_not_taken_for_ink() -> None:
    bench = Bench(block(30, 30), (scaled(0.9),), "scale")
    i, j = np.indices(bench.height.shape)
    for layer in range(1, 11):
        bench.print(bench.full_pattern(), drift=layer * (2e-6 + 0.1e-6 * i - 0.2e-6 * j))
    assert bench.estimate.ink_scale == pytest.approx(0.9, abs=1e-3)
    np.testing.assert_allclose(bench.estimate.height, bench.height, atol=1e-11)


def test_noise_does_not_move_the_ink() -> None:
    bench = Bench(block(34, 34), (Ink(),), "scale", noise_std=1e-6)
    for _ in range(20):
        bench.print(bench.full_pattern())
        assert bench.estimate.ink_scale == pytest.approx(1.0, abs=0.02)


def test_drifting_ink_is_followed() -> None:
    bench = Bench(block(30, 30), (Ink(),), "scale")
    for layer in range(40):
        bench.print(bench.full_pattern(), np.full(bench.height.shape, 1.0 - 0.005 * layer))
    assert bench.estimate.ink_scale == pytest.approx(0.805, abs=0.03)


@pytest.mark.parametrize("model", ["scale", "full"])
@pytest.mark.parametrize("droplets", [0, 3])
def test_nothing_is_learnt_where_little_is_printed(model: InkModel, droplets: int) -> None:
    bench = Bench(block(20, 20), (scaled(0.85),), model, noise_std=1e-6)
    bench.print(bench.full_pattern())
    learnt = bench.estimate.inks
    pattern = np.zeros(bench.height.shape, np.int32)
    pattern[10, 5 : 5 + droplets] = 1
    for _ in range(5):
        assert bench.print(pattern).inks == learnt


def test_nominal_ink_is_kept_on_request() -> None:
    bench = Bench(block(20, 20), (scaled(0.8),), "off")
    assert bench.print(bench.full_pattern()).inks == bench.job.inks


@pytest.mark.parametrize(("droplets", "learns"), [(30, False), (90, True)])
def test_layer_below_a_tenth_of_a_full_one_is_no_evidence(droplets: int, learns: bool) -> None:
    """Of 676 cells; many more droplets than show an ink at all."""
    bench = Bench(block(30, 30), (scaled(0.85),), "scale")
    pattern = np.zeros(bench.height.shape, np.int32)
    chosen = np.random.default_rng(3).permutation(np.argwhere(bench.job.mask))[:droplets]
    pattern[tuple(chosen.T)] = 1
    assert (bench.print(pattern).inks != bench.job.inks) == learns

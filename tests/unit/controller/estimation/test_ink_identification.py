"""Learning of the ink from the layers of a print, and disturbances that are not caused by the ink."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.estimation.estimate_figures import UntrustedReason
from inkloop_controller.estimation.height_estimator import Estimate, HeightEstimator, InkModel
from inkloop_controller.model.layer_model import LayerModel
from support.closed_loop import block

OTHER = Ink(3.7e-6, 0.75e-6, 0.15e-6)


class Bench:
    """A job printed with other ink than the nominal one, on a rough substrate, scanned with noise."""

    def __init__(
        self, job: Job, inks: tuple[Ink, ...], model: InkModel, noise_std: float = 0.0, seed: int = 0, **options: Any
    ) -> None:
        self.job, self.noise_std, self.rng = job, noise_std, np.random.default_rng(seed)
        self.plant = LayerModel(inks, job.passes)
        self.estimator = HeightEstimator(
            job, adapt_ink=model, sensor_noise_std=noise_std, flat_ground=False, register_scans=False, **options
        )
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


@pytest.mark.parametrize("volume", [0.6, 0.8, 0.9, 1.2])
@pytest.mark.parametrize("passes", [1, 4])
def test_volume_is_known_after_a_full_layer(volume: float, passes: int) -> None:
    bench = Bench(block(20, 20, passes=passes), (scaled(volume),), "scale")
    assert bench.print(bench.full_pattern()).ink_scale == pytest.approx(volume, abs=0.02)
    for _ in range(5):
        bench.print(bench.full_pattern())
    assert bench.estimate.ink_scale == pytest.approx(volume, abs=5e-3)
    assert not bench.estimate.figures.reasons


def test_three_heights_are_learnt_where_random_layers_separate_them() -> None:
    bench = Bench(block(44, 44), (OTHER,), "full", noise_std=0.3e-6)
    for _ in range(4):
        bench.print(bench.random_pattern())
    found = shares(bench.estimate.inks[0], OTHER)
    assert found[0] == pytest.approx(1.0, abs=0.03)
    assert found[1] == pytest.approx(1.0, abs=0.05)
    assert found[2] == pytest.approx(1.0, abs=0.25)


def test_noise_of_a_micrometre_biases_the_three_heights_little() -> None:
    """Least squares without instruments is off by -6 % in h1 and +39 % in h3."""
    found = []
    for seed in range(10):
        bench = Bench(block(24, 24), (OTHER,), "full", noise_std=1e-6, seed=seed)
        for _ in range(10):
            bench.print(bench.random_pattern())
        found.append(shares(bench.estimate.inks[0], OTHER))
    np.testing.assert_array_less(np.abs(np.mean(found, axis=0) - 1.0), [0.03, 0.05, 0.2])


@pytest.mark.parametrize("model", ["scale", "full"])
def test_each_of_two_inks_is_learnt_separately(model: InkModel) -> None:
    nominal = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
    true = (scaled(0.85), Ink(1.1 * 3.9e-6, 1.1 * 0.55e-6, 1.1 * 0.15e-6))
    bench = Bench(block(44, 44, inks=nominal), true, model)
    for _ in range(3):
        bench.print(bench.random_pattern())
    for found, ink in zip(bench.estimate.inks, true, strict=True):
        assert found.layer_height == pytest.approx(ink.layer_height, rel=0.01, abs=0.0)


@pytest.mark.parametrize("model", ["scale", "full"])
def test_dead_nozzles_lower_no_volume(model: InkModel) -> None:
    bench = Bench(block(34, 34), (scaled(0.9),), model)
    factor = np.ones(bench.height.shape)
    factor[:, [9, 21]] = 1e-9
    for _ in range(10):
        bench.print(bench.full_pattern() if model == "scale" else bench.random_pattern(), factor)
    assert bench.estimate.ink_scale == pytest.approx(0.9, rel=0.02, abs=0.0)


def test_drift_and_tilt_of_the_sensor_are_not_taken_for_ink() -> None:
    """Ground that no droplet reaches begins four cells from the part."""
    job = block(34, 34)
    job.mask[:] = False
    job.mask[7:-7, 7:-7] = True
    bench = Bench(job, (scaled(0.9),), "scale")
    i, j = np.indices(bench.height.shape)
    for layer in range(1, 11):
        bench.print(bench.full_pattern(), drift=layer * (1e-6 + 0.05e-6 * i - 0.1e-6 * j))
    assert bench.estimate.ink_scale == pytest.approx(0.9, abs=2e-3)
    np.testing.assert_allclose(bench.estimate.height, bench.height, rtol=0.0, atol=1e-8)


def test_drifting_ink_is_followed() -> None:
    bench = Bench(block(30, 30), (Ink(),), "scale")
    for layer in range(40):
        bench.print(bench.full_pattern(), np.full(bench.height.shape, 1.0 - 0.005 * layer))
    assert bench.estimate.ink_scale == pytest.approx(0.805, abs=0.03)
    assert not bench.estimate.figures.stop


@pytest.mark.parametrize("model", ["scale", "full"])
def test_nothing_is_learnt_where_nothing_is_printed(model: InkModel) -> None:
    bench = Bench(block(20, 20), (scaled(0.85),), model, noise_std=1e-6)
    learnt = bench.print(bench.full_pattern()).inks
    for _ in range(5):
        found = bench.print(np.zeros(bench.height.shape, np.int32)).inks
        np.testing.assert_allclose([shares(*pair) for pair in zip(found, learnt, strict=True)], 1.0, atol=1e-9)


@pytest.mark.parametrize(("volume", "stops"), [(0.4, True), (0.55, False), (1.2, False), (1.5, True)])
def test_volume_that_is_not_believed_of_any_ink_stops_the_print(volume: float, stops: bool) -> None:
    bench = Bench(block(20, 20), (scaled(volume),), "scale")
    for _ in range(8):
        figures = bench.print(bench.full_pattern()).figures
    assert figures.stop == (UntrustedReason.VOLUME if stops else UntrustedReason(0))
    if stops:
        assert 2 <= figures.stop_layer <= 5
        assert figures.stop_figure == pytest.approx(volume, abs=0.05)


def test_volumes_that_are_believed_are_those_that_were_asked_for() -> None:
    bench = Bench(block(20, 20), (scaled(0.75),), "scale", volume_least=0.8)
    for _ in range(5):
        bench.print(bench.full_pattern())
    assert bench.estimate.figures.stop == UntrustedReason.VOLUME
    with pytest.raises(ValueError, match=r"volume_least is 1\.5; needs a share of the nominal volume of 0\.01 to 1"):
        HeightEstimator(bench.job, volume_least=1.5)

"""The cylinder of Lu, Zheng, Mishra (2015) with a sensor like theirs, and an ink that the controller does not know.

Planned three layers ahead; the sensor has 1 um of noise and steps of 0.1 um.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop_controller.controllers import LayerMpcController
from support.closed_loop import cylinder, print_part
from support.long_proofs import rest_is_long

SEEDS = range(2)


def mean_errors(variation: float, drift: float = 0.0, **options: Any) -> Any:
    """(|bias|, mae, std) in um, means over the seeds; `drift`: of the scans [m], which have noise and a resolution."""
    job = cylinder()

    def errors(seed: int) -> tuple[float, float, float]:
        def scan(height: Any, layer: int) -> Any:
            noise = np.random.default_rng([seed, layer]).normal(0.0, 1e-6, height.shape)
            return np.round((height + noise + drift * layer) / 0.1e-6) * 0.1e-6

        done = print_part(LayerMpcController(job, horizon=3, **options), job, variation=variation, seed=seed, scan=scan)
        return done.errors_um(job)

    return np.abs(np.mean([errors(seed) for seed in SEEDS], axis=0))


@pytest.mark.parametrize(("variation", "mae", "std"), rest_is_long([(0.4, 0.66, 0.85), (0.2, 0.50, 0.65)], 0))
def test_laser_costs_little_against_an_exact_sensor(variation: float, mae: float, std: float) -> None:
    bias, found_mae, found_std = mean_errors(variation)
    assert bias < 0.2
    assert found_mae < mae
    assert found_std < std


def test_drift_of_the_sensor_does_not_reach_the_part() -> None:
    bias, mae, std = mean_errors(0.2, drift=0.1e-6)
    assert bias < 0.2
    assert mae < 0.50
    assert std < 0.65


@pytest.mark.long
def test_readings_taken_for_the_truth_double_the_error() -> None:
    _, taken, _ = mean_errors(0.2, sensor_noise_std_um=0.0)
    _, learnt, _ = mean_errors(0.2)
    assert taken > 2.0 * learnt

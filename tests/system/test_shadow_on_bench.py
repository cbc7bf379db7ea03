"""A shadow next to the emulator: silent where it prints as the model, an alarm where it does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from inkloop.printing.run import print_part
from inkloop.scenario.file import Scenario
from support.benches.bench_run import BLOCK, emulated, write

EXACT = BLOCK.replace("noise_std_um = 0.1\n", "").replace("dropout_rate = 0.02\n", "").replace("variation = 0.2\n", "")
SHADOW = '\n[components.shadow]\nkind = "Shadow"\n'
STEP = 0.1e-6
"""The emulated sensor's resolution [m]."""


def test_shadow_of_a_bench_without_variation_differs_by_the_sensor_steps_only(tmp_path: Path) -> None:
    """Four passes with another order in each layer, over CAN, next to the FMU."""
    path = write(tmp_path, EXACT + SHADOW)
    with emulated(path) as (_, channel):
        run = print_part(Scenario.load(path, {"bench.channel": channel})).dataset
    assert run.sizes["layer"] >= 3
    assert run.growth_divergence[1:].max() < STEP
    assert run.surface_divergence.max() < STEP
    assert not run.shadow_status.any()
    np.testing.assert_array_equal(run.height, run.measured_height)


def test_bench_that_jets_less_than_the_model_is_reported_from_the_first_layer_on(tmp_path: Path) -> None:
    path = write(tmp_path, EXACT + SHADOW + "alarm_um = 1.0\n")
    with emulated(path, {"components.printer.h1_a_um": 2.2}) as (_, channel):
        run = print_part(Scenario.load(path, {"bench.channel": channel})).dataset
    assert run.shadow_status[1:3].values.tolist() == [4, 4]
    assert float(run.growth_divergence[1]) == pytest.approx(2.2e-6, rel=0.2, abs=0.0)


def test_bench_prints_under_a_simulated_sensor_that_scans_its_shadow(tmp_path: Path) -> None:
    path = write(tmp_path, EXACT + SHADOW + 'start = "job"\n')
    with emulated(path) as (_, channel):
        run = print_part(
            Scenario.load(path, {"bench.channel": channel, "components.profiler.kind": "ProfileSensor"})
        ).dataset
    np.testing.assert_array_equal(run.height, run.shadow_height)
    np.testing.assert_allclose(run.measured_height, run.shadow_height, atol=STEP)
    assert float(np.abs(run.mean_error[-1])) < 5e-6

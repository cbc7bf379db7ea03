"""The emulator prints and measures what the FMUs do, bit for bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.benches.node_bench import DONE, NodeBench, heights
from support.fmus.fmu_driver import OK, Driver
from support.numpy import lu_numpy

SHAPE = (11, 9)
RESOLUTION = 1e-7
pytestmark = pytest.mark.compiled

VARIATIONS: list[dict[str, float]] = [
    {},
    {"variation": 0.2, "variation_kind": 1},
    {"variation": 0.2, "variation_kind": 2, "nozzle_variation": 0.3, "nozzle_pitch": 4},
    {"variation": 0.1, "variation_kind": 4, "h1_b": 3.9e-6, "h2_b": 0.5e-6},
]
SENSORS: list[dict[str, float]] = [
    {},
    {"noise_std": 1e-6, "noise_correlation": 0.3, "tilt_x": 1e-3, "drift_rate": 0.2e-6},
    {"noise_std": 0.5e-6, "spot_radius": 200e-6, "slope_bias": 2e-6, "dropout_rate": 0.1, "dropout_slope": 0.02},
]


def colours(order: int, rotation: int, layer: int) -> tuple[int, ...]:
    """Colours of the passes of a layer, as the master sends them to the head."""
    names = [2 * i + j for i, j in lu_numpy.ORDERS[order]]
    return tuple(names[(rotation * layer + number) % 4] for number in range(4))


@pytest.mark.parametrize("variation", VARIATIONS, ids=str)
@pytest.mark.parametrize(("order", "rotation"), [(1, 0), (2, 1)])
def test_surface_of_four_passes_is_that_of_the_fmu(variation: dict[str, Any], order: int, rotation: int) -> None:
    nx, ny = SHAPE
    patterns = np.random.default_rng(3).integers(0, 3, (4, nx, ny))
    parameters = {"passes": 4, "pass_order": order, "pass_rotation": rotation, "seed": 5, **variation}
    with (
        NodeBench(nx=nx, ny=ny, printer_seed=5, pass_ms=10, **variation) as bench,
        Driver("LayerDeposition", nx=nx, ny=ny).start(parameters) as fmu,
    ):
        bench.ready()
        for layer, pattern in enumerate(patterns, start=1):
            bench.print_layer(pattern, layer, colours(order, rotation, layer))
            np.testing.assert_array_equal(bench.surface, fmu.print_layer(pattern.astype(np.int32)))


@pytest.mark.parametrize("sensor", SENSORS, ids=str)
def test_maps_are_those_of_the_fmu(sensor: dict[str, Any]) -> None:
    """Also the second and third one: noise and drift go by the number of the scan."""
    nx, ny = SHAPE
    parameters: dict[str, Any] = {"seed": 6, "resolution": RESOLUTION, "scan_duration": 0.0, **sensor}
    surfaces = np.random.default_rng(4).uniform(0.0, 20e-6, (3, nx, ny))
    with (
        NodeBench(nx=nx, ny=ny, sensor_seed=6, resolution=RESOLUTION, **sensor) as bench,
        Driver("ProfileSensor", nx=nx, ny=ny).start(parameters) as fmu,
    ):
        bench.ready()
        for layer, surface in enumerate(surfaces):
            bench.surface[:] = surface
            assert bench.scan(layer) == DONE
            found, valid = heights(bench.upload(layer), RESOLUTION)
            fmu.set("height", surface)
            fmu.set("layers_printed", layer)
            assert fmu.step(float(layer)) == OK
            np.testing.assert_array_equal(valid, fmu.get("valid"))
            np.testing.assert_array_equal(found[valid], fmu.get("measured_height")[valid])

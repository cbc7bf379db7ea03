"""A life of every model: parameters with which it has something to do, and steps with new layers or scans."""

from __future__ import annotations

import numpy as np
import pytest

from support.fmus.fmu_driver import MODELS, OK, Driver, random_patterns

EVERY_MODEL = pytest.mark.parametrize("model", MODELS)
PARAMETERS = {
    "LayerDeposition": {"variation": 0.3, "passes": 4, "pass_rotation": 1, "layer_duration": 2.5},
    "SuperpositionDeposition": {"variation": 0.3, "layer_duration": 2.5},
    "VolumeAreaDeposition": {"variation": 0.3, "passes": 4, "pass_rotation": 1, "guard": True, "layer_duration": 2.5},
    "YoungLaplaceDeposition": {"variation": 0.3, "pass_rotation": 1, "cells_per_pitch": 4, "layer_duration": 2.5},
    "ProfileSensor": {"noise_std": 1e-6, "dropout_rate": 0.3, "drift_rate": 1e-7, "scan_duration": 2.5},
    "LayerController": {"passes": 4, "horizon": 2, "sensor_noise_std": 1e-6, "annealing_sweeps": 3},
}


def started(model: str, form: str, seed: int = 1) -> Driver:
    """An instance on a grid of 5 x 4 cells in Step Mode."""
    return Driver(model, form, 5, 4).start({**PARAMETERS[model], "seed": seed})


def offer(fmu: Driver, layer: int) -> None:
    """Set the inputs with which the next step has something to do."""
    surface = np.random.default_rng(layer).uniform(0.0, 1e-5, (fmu.nx, fmu.ny))
    if "measured_height" in fmu.references and fmu.roles["measured_height"] == "input":
        scanned = int(fmu.get("layer_command"))
        assert max(fmu.set("measured_height", surface), fmu.set("layers_scanned", scanned)) == OK
        assert fmu.set("layers_printed", scanned) == OK
    elif "pattern" in fmu.references:
        assert fmu.set("pattern", random_patterns(fmu.nx, fmu.ny, 1, seed=layer)[0]) == OK
        assert fmu.set("layer_command", layer) == OK
    else:
        assert max(fmu.set("height", surface), fmu.set("layers_printed", layer)) == OK


def act(fmu: Driver, first: int, last: int) -> None:
    """Steps of 1 s from `first` to `last`, with a new layer each 3 s."""
    for time in range(first, last):
        if time % 3 == 0:
            offer(fmu, time // 3 + 1)
        assert fmu.step(float(time)) == OK

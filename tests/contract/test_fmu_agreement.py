"""FMI 3, FMI 3 with a fixed grid, FMI 2 and NumPy are the same model."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from fmpy import simulate_fmu

from inkloop.fmu_writer.export import find_fmu
from support.fmus.fmu_driver import DEPOSITION_MODELS, FORMS, OK, Driver, random_patterns
from support.numpy import lu_numpy, sensor_numpy

GRIDS = [(8, 5), (1, 7), (6, 1), (1, 1), (5, 8)]
PITCH = 263.256e-6


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(
    ("nx", "ny", "kind"), [(9, 9, 1), (1, 7, 2), (6, 1, 3), (1, 1, 4), (5, 8, 2), (8, 5, 3), (7, 7, 4)]
)
@pytest.mark.parametrize("passes", [1, 4])
def test_deposition_is_the_reference_model_over_five_layers(form, nx, ny, kind, passes) -> None:
    inks = (lu_numpy.INK, (3e-6, 0.9e-6, 0.3e-6))
    start = np.random.default_rng(1).uniform(0.0, 10e-6, (nx, ny))
    varied: dict[str, Any] = {"variation": 0.3, "nozzle_pitch": 3, "nozzle_variation": 0.1, "seed": 77}
    own: dict[str, Any] = {"h1_b": 3e-6, "h2_b": 0.9e-6, "h3_b": 0.3e-6, "pass_order": 2, "pass_rotation": 1}
    own |= {"passes": passes, "variation_kind": kind, "height_start": start}
    surface, lost = start, 0.0
    with Driver("LayerDeposition", form, nx, ny).start({**varied, **own}) as fmu:
        for number, pattern in enumerate(random_patterns(nx, ny, 5), start=1):
            factor = lu_numpy.factors((nx, ny), number, kind=kind, **varied)
            surface, fell = lu_numpy.layer(surface, pattern, inks, factor, passes, 2, 1, number)
            lost += fell
            assert fmu.print_layer(pattern) == pytest.approx(surface, rel=1e-12, abs=0.0)
            assert fmu.get("height_mean") == pytest.approx(surface.mean(), rel=1e-12, abs=0.0)
        assert fmu.get("volume_lost") == pytest.approx(lost * PITCH**2, rel=1e-12, abs=0.0)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("nx", "ny"), GRIDS)
def test_grey_droplets_under_a_roller_are_the_reference_model(form, nx, ny) -> None:
    generator = np.random.default_rng(9)
    varied: dict[str, Any] = {"variation": 0.3, "seed": 5}
    surface, cut, drops = np.zeros((nx, ny)), 0.0, 0
    with Driver("LayerDeposition", form, nx, ny).start({**varied, "roller_step": 9e-6, "roller_datum": 1e-6}) as fmu:
        for number, pattern in enumerate(random_patterns(nx, ny, 5), start=1):
            level = generator.integers(0, 4, (nx, ny)).astype(np.int32)
            jetted = np.where(level > 0, pattern, 0)
            factor = level * lu_numpy.factors((nx, ny), number, **varied)
            surface, _ = lu_numpy.layer(surface, jetted, factor=factor, number=number)
            surface, removed = lu_numpy.rolled(surface, 1e-6 + number * 9e-6)
            cut, drops = cut + removed, drops + int(level[pattern == 1].sum())
            assert fmu.set("drop_level", level) == OK
            assert fmu.print_layer(pattern) == pytest.approx(surface, rel=1e-12, abs=0.0)
        assert fmu.get("volume_removed") == pytest.approx(cut * PITCH**2, rel=1e-12, abs=0.0)
        assert fmu.get("droplets_a") == drops


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize(("nx", "ny"), GRIDS)
def test_sensor_is_the_reference_model_over_five_scans(form, nx, ny) -> None:
    sign = 1.0 if nx < ny else -1.0
    parameters: dict[str, Any] = {
        "noise_std": 1e-6,
        "noise_correlation": 0.3,
        "bias": sign * 2e-6,
        "drift_rate": sign * 0.5e-6,
        "tilt_x": sign * 1e-3,
        "tilt_y": sign * 2e-3,
        "resolution": 0.1e-6,
        "shift_x": sign * 60e-6,
        "shift_y": sign * -400e-6,
        "shift_std": 20e-6,
        "spot_radius": 200e-6,
        "slope_bias": 3e-6,
        "dropout_slope": 0.05,
        "dropout_rate": 0.2,
        "seed": 4,
    }
    last = np.zeros((nx, ny))
    with Driver("ProfileSensor", form, nx, ny).start({"scan_duration": 0.0, **parameters}) as fmu:
        for number in range(5):
            surface = np.random.default_rng(number).uniform(0.0, 50e-6, (nx, ny))
            assert max(fmu.set("height", surface), fmu.set("layers_printed", 3 * number)) == OK
            assert fmu.step(float(number)) == OK
            reading, valid = sensor_numpy.scan(surface, number, pitch=PITCH, **parameters)
            last = np.where(valid, reading, last)
            assert np.array_equal(fmu.get("valid"), valid)
            assert fmu.get("measured_height") == pytest.approx(last, rel=1e-12, abs=1e-18)


@pytest.mark.parametrize("model", DEPOSITION_MODELS)
def test_the_three_forms_give_the_same_bits(model) -> None:
    surfaces = []
    for form in FORMS:
        with Driver(model, form, 5, 8).start({"variation": 0.3}) as fmu:
            for pattern in random_patterns(5, 8, 4):
                fmu.print_layer(pattern)
            surfaces.append(fmu.get("height"))
    assert np.array_equal(surfaces[0], surfaces[1])
    assert np.array_equal(surfaces[0], surfaces[2])


@pytest.mark.parametrize("form", FORMS)
def test_deposition_alone_prints_a_block_in_an_ordinary_importer(form) -> None:
    result = simulate_fmu(
        str(find_fmu("LayerDeposition", form)),
        start_values={"layer_period": 0.5, "layer_duration": 0.25},
        output_interval=1.0,
        stop_time=4.0,
        output=["layers_printed", "height_mean"],
    )
    assert result["layers_printed"].tolist() == [0, 1, 3, 5, 7]
    surface = np.zeros((9, 9))
    for _ in range(7):
        surface, _ = lu_numpy.layer(surface, np.ones((9, 9), dtype=int))
    assert result["height_mean"][-1] == pytest.approx(surface.mean(), rel=1e-12, abs=0.0)

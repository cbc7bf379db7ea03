"""Invariants of the sum of spherical caps, shown on the FMU."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from support.fmus.fmu_driver import ERROR, OK, Driver, random_patterns
from support.numpy import caps_numpy, lu_numpy

PITCH = 263.256e-6
CAP = (206.5e-6, 4.4e-6)


def printed(nx: int, ny: int, patterns, **parameters):
    """Surfaces after each layer."""
    with Driver("SuperpositionDeposition", nx=nx, ny=ny).start(parameters) as fmu:
        return [fmu.print_layer(pattern) for pattern in patterns]


def one_drop(nx: int, ny: int):
    pattern = np.zeros((nx, ny), dtype=np.int32)
    pattern[nx // 2, ny // 2] = 1
    return pattern


@pytest.mark.parametrize("radius", [30e-6, 131.628e-6, 186.1e-6, 206.5e-6, 394.884e-6, 1000e-6, 2237e-6])
@pytest.mark.parametrize("height", [1e-9, 4.4e-6, 30e-6])
def test_interior_droplet_adds_the_volume_of_its_cap(radius, height) -> None:
    (surface,) = printed(17, 19, [one_drop(17, 19)], cap_radius_a=radius, cap_height_a=height)
    assert surface.sum() * PITCH**2 == pytest.approx(caps_numpy.volume(radius, height), rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("radius", "height"),
    [(206.5e-6, 4.4e-6), (120e-6, 120e-6), (131.628e-6, 50e-6), (186.15e-6, 1e-6), (500e-6, 499e-6), (700e-6, 2e-6)],
)
def test_height_of_a_cell_is_the_mean_of_the_cap_over_it(radius, height) -> None:
    (surface,) = printed(9, 9, [one_drop(9, 9)], cap_radius_a=radius, cap_height_a=height)
    whole = caps_numpy.volume(radius, height) / PITCH**2
    for i, j in np.ndindex(9, 9):
        mean = caps_numpy.over(radius, height, abs(i - 4) * PITCH, abs(j - 4) * PITCH, PITCH)[0] / PITCH**2
        assert surface[i, j] == pytest.approx(mean, abs=1e-11 * whole)


@pytest.mark.parametrize(("nx", "ny"), [(8, 5), (1, 7), (5, 8), (1, 1)])
def test_layers_are_those_of_the_reference_model(nx, ny) -> None:
    caps = (CAP, (420e-6, 9e-6))
    varied: dict[str, Any] = {"variation": 0.3, "nozzle_pitch": 3, "nozzle_variation": 0.1, "seed": 77}
    own = {"cap_radius_b": 420e-6, "cap_height_b": 9e-6}
    surface, lost = np.zeros((nx, ny)), 0.0
    with Driver("SuperpositionDeposition", nx=nx, ny=ny).start({**varied, **own}) as fmu:
        for number, pattern in enumerate(random_patterns(nx, ny, 4), start=1):
            factor = lu_numpy.factors((nx, ny), number, **varied)
            surface, fell = caps_numpy.layer(surface, pattern, caps, PITCH, factor)
            lost += fell
            # a cell of 1.3 nm, a difference of two large volumes, has lost five digits to rounding
            assert fmu.print_layer(pattern) == pytest.approx(surface, rel=1e-11, abs=1e-18)
        assert fmu.get("volume_lost") == pytest.approx(lost * PITCH**2, rel=1e-11, abs=0.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"cap_height_b": 3e-4}, "cap_height_b is 0.0003 m on a cap_radius_b of 0.0002065 m; expected at most"),
        ({"cap_radius_b": 3e-3}, "cap_radius_b is 0.003 m on a pitch of 0.000263256 m; expected at most 0.00223768 m"),
        ({"cap_radius_a": 3e-3}, r"cap_radius_a is 0.003 m on a pitch of 0.000263256 m; expected at most 0.00223768 m"),
    ],
)
def test_cap_that_no_drop_has_is_refused_with_a_message(parameters, message) -> None:
    with Driver("SuperpositionDeposition") as fmu:
        for name, value in parameters.items():
            assert fmu.set(name, value) == OK
        assert fmu.enter() == OK
        assert fmu.exit() == ERROR
        assert message in fmu.messages[-1]
        for name in parameters:
            assert fmu.set(name, 1e-4) == OK
        assert fmu.exit() == OK

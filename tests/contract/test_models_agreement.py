"""The deposition models from Python and the FMUs are the same kernels: they agree to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_lab.models import (
    DropletVolumes,
    LayerDeposition,
    SuperpositionDeposition,
    VolumeAreaDeposition,
    YoungLaplaceDeposition,
)
from support.fmus.fmu_driver import Driver, random_patterns

VARIATION = {"variation": 0.3, "variation_kind": 4, "nozzle_pitch": 3, "nozzle_variation": 0.1, "seed": 11}
PASSES = [{"passes": 1}, {"passes": 4, "pass_order": 2, "pass_rotation": 1}]
FLAT = LayerDeposition().start(np.zeros((3, 3)))
HEIGHTS = ((4.4e-6, 0.6e-6, 0.2e-6), (3.9e-6, 0.5e-6, 0.1e-6))
FAR = tuple((*ink, 0.15e-6, 0.1e-6, 0.05e-6) for ink in HEIGHTS)
FURTHEST = tuple((*ink, 0.03e-6, 0.02e-6, 0.01e-6, 0.01e-6) for ink in FAR)


def parameters_of_heights(heights):
    reach = {3: 1, 6: 2, 10: 3}[len(heights[0])]
    named = {f"h{k + 1}_{material}": h for material, ink in zip("ab", heights, strict=True) for k, h in enumerate(ink)}
    return {**named, "reach": reach}


def check_agreement(model, name, parameters, nx, ny, start, layers=4, patterns=None):
    volumes = DropletVolumes(0.3, 4, 0.1, 3, 11)
    surface = model.start(start)
    with Driver(name, nx=nx, ny=ny).start({**parameters, **VARIATION, "height_start": start}) as fmu:
        for number, pattern in enumerate(patterns or random_patterns(nx, ny, layers), start=1):
            surface = model.layer(surface, pattern, number, volumes.of_layer(nx, ny, number))
            assert np.array_equal(fmu.print_layer(pattern), surface.height)
        return surface, fmu.outputs()


@pytest.mark.parametrize("passes", PASSES)
@pytest.mark.parametrize("heights", [HEIGHTS, FAR, FURTHEST], ids=["reach 1", "reach 2", "reach 3"])
def test_layer_deposition_gives_the_bits_of_its_fmu(heights, passes) -> None:
    start = np.random.default_rng(1).uniform(0.0, 8e-6, (8, 7))
    parameters = {**parameters_of_heights(heights), **passes}
    surface, outputs = check_agreement(LayerDeposition(heights, **passes), "LayerDeposition", parameters, 8, 7, start)
    assert outputs["volume_lost"] == pytest.approx(surface.lost * 263.256e-6**2, rel=1e-12, abs=0.0)


def test_superposition_deposition_gives_the_bits_of_its_fmu() -> None:
    caps = ((206.5e-6, 4.4e-6), (420e-6, 9e-6))
    parameters = {"cap_radius_b": 420e-6, "cap_height_b": 9e-6}
    check_agreement(SuperpositionDeposition(caps), "SuperpositionDeposition", parameters, 8, 7, np.full((8, 7), 2e-6))


@pytest.mark.parametrize("passes", PASSES)
@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("tamed", [False, True])
def test_volume_area_deposition_gives_the_bits_of_its_fmu(tamed, order, passes) -> None:
    options = {"guard": tamed, "limit_gains": tamed, "drop_order": order, "cap_radius": 60e-6, "mv_plus": 5e3, **passes}
    start = np.random.default_rng(2).uniform(0.0, 2e-6, (8, 7))
    model = VolumeAreaDeposition(**options)
    surface, outputs = check_agreement(model, "VolumeAreaDeposition", options, 8, 7, start)
    assert np.array_equal(outputs["area"], surface.area)


@pytest.mark.parametrize("passes", PASSES)
@pytest.mark.parametrize("form", ["linear", "nonlinear"])
def test_young_laplace_deposition_gives_the_bits_of_its_fmu(form, passes) -> None:
    options = {"cells_per_pitch": 4, "contact_angle": 0.9, **passes}
    model = YoungLaplaceDeposition(form=form, **options)
    start = np.random.default_rng(3).uniform(0.0, 2e-6, (6, 7))
    parameters = {**options, "form": {"linear": 1, "nonlinear": 2}[form]}
    surface, outputs = check_agreement(model, "YoungLaplaceDeposition", parameters, 6, 7, start, layers=2)
    assert outputs["fallbacks"] == surface.fallbacks
    assert outputs["volume_lost"] == surface.lost
    assert surface.over_grid.shape == (24, 28)
    assert surface.over_grid.reshape(6, 4, 7, 4).mean((1, 3)) == pytest.approx(surface.height, rel=1e-12, abs=0.0)


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        (LayerDeposition.of([Ink()]), 7.6e-6),
        (SuperpositionDeposition(), SuperpositionDeposition().layer_height),
        (VolumeAreaDeposition(), 7.0751e-6),
        (YoungLaplaceDeposition(cells_per_pitch=4), 30e-15 / 42.3e-6**2),
    ],
    ids=lambda model: type(model).__name__,
)
def test_interior_droplet_adds_its_volume_to_a_surface_of_its_own(model, expected) -> None:
    height, pattern = np.zeros((9, 9)), np.zeros((9, 9), np.int32)
    pattern[4, 4] = 1
    surface = model.start(height)
    assert model.layer(surface, pattern).height.sum() == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert not height.any()  # arguments stay as they were
    assert not surface.height.any()


def layer_of_many_droplets(volume: float) -> None:
    model = YoungLaplaceDeposition(cells_per_pitch=4)
    model.layer(model.start(np.zeros((3, 3))), np.ones((3, 3), int), 1, np.full((3, 3), volume))


def test_ink_that_leaves_over_the_edge_is_added_up_layer_by_layer() -> None:
    """Of a droplet in a corner: two sides and three corners of the first model; caps lose what lies beyond the grid."""
    pattern = np.zeros((4, 5), np.int32)
    pattern[0, 0] = 1
    for model in (LayerDeposition(), SuperpositionDeposition()):
        surfaces = [model.start(np.zeros((4, 5)))]
        for number in range(1, 4):
            surfaces.append(model.layer(surfaces[-1], pattern, number))
        first = surfaces[1].lost
        assert first > 0.0
        for number, surface in enumerate(surfaces):
            added = number * (7.6e-6 if isinstance(model, LayerDeposition) else model.layer_height)
            assert surface.height.sum() + surface.lost == pytest.approx(added, rel=1e-9, abs=1e-18)
    once = LayerDeposition().layer(LayerDeposition().start(np.zeros((4, 5))), pattern)
    assert once.lost == pytest.approx(2 * 0.6e-6 + 3 * 0.2e-6, rel=1e-9, abs=0.0)


def test_models_leave_the_surface_that_they_print_on_as_it_was() -> None:
    pattern = np.ones((3, 3), np.int32)
    models: list[Any] = [LayerDeposition(), SuperpositionDeposition(), VolumeAreaDeposition(), YoungLaplaceDeposition()]
    for model in models:
        surface = model.start(np.full((3, 3), 1e-6))
        before = {name: np.copy(value) for name, value in vars(surface).items()}
        model.layer(surface, pattern)
        for name, value in before.items():
            np.testing.assert_array_equal(getattr(surface, name), value)


def test_second_ink_has_the_cap_of_the_first_where_it_has_none_of_its_own() -> None:
    one, other = SuperpositionDeposition(), SuperpositionDeposition(((206.5e-6, 4.4e-6), (150e-6, 3e-6)))
    pattern = np.zeros((5, 5), np.int32)
    pattern[2, 2] = 2
    grown = other.layer(other.start(np.zeros((5, 5))), pattern).height.sum()
    expected = np.pi / 6.0 * 3e-6 * (3.0 * 150e-6**2 + 3e-6**2) / 263.256e-6**2
    assert grown == pytest.approx(expected, rel=1e-9, abs=0.0)
    assert grown != pytest.approx(one.layer_height, rel=0.1, abs=0.0)


def test_ink_lies_on_the_substrate_that_is_given() -> None:
    model = VolumeAreaDeposition()
    height, area, substrate = np.full((3, 3), 3e-6), np.full((3, 3), 0.5), np.full((3, 3), 1e-6)
    surface = model.start(height, area, substrate)
    np.testing.assert_allclose(surface.covered_height, 4e-6, rtol=1e-12)
    np.testing.assert_allclose(model.start(height, area).covered_height, 6e-6, rtol=1e-12)
    np.testing.assert_array_equal(model.start(height).covered_height, 0.0)


@pytest.mark.parametrize(
    ("attempt", "message"),
    [
        (lambda: LayerDeposition(((1e-6, 2e-6),)), "needs 3, 6 or 10"),
        (lambda: LayerDeposition(passes=2), "needs 1 or 4 passes"),
        (lambda: LayerDeposition(((-1e-6, 0.0, 0.0),)), "at least 0 m"),
        (lambda: SuperpositionDeposition(((1e-6, 2e-6),)), "at most the radius"),
        (lambda: SuperpositionDeposition(((1.0, 1e-6),)), "8.5 pitches"),
        (lambda: VolumeAreaDeposition(mv_plus=np.nan), "finite"),
        (lambda: VolumeAreaDeposition().start(np.zeros((3, 3)), np.full((3, 3), 2.0)), "areas of 0 to 1"),
        (lambda: YoungLaplaceDeposition(pitch=10e-6), "at most 2 pitches"),
        (lambda: YoungLaplaceDeposition(form="exact"), "linear"),  # type: ignore[arg-type]
        (lambda: LayerDeposition().start(np.full((3, 3), np.nan)), "not finite in 9 cells"),
        (lambda: LayerDeposition().start(np.full((3, 3), -30.0)), "height reaches 30; needs heights in metres, within"),
        (lambda: YoungLaplaceDeposition().start(np.eye(3)), "height reaches 1; needs heights in metres, within 0.4 m"),
        (lambda: LayerDeposition().layer(FLAT, np.ones((2, 3), int)), "shape"),
        (lambda: LayerDeposition().layer(FLAT, np.full((3, 3), 2)), "one material"),
        (lambda: LayerDeposition().layer(FLAT, np.full((3, 3), 3)), "0, 1 or 2"),
        (
            lambda: LayerDeposition().layer(FLAT, np.full((3, 3), -1)),
            r"pattern is -1 in cell \(0, 0\); needs 0, 1 or 2",
        ),
        (lambda: LayerDeposition().layer(FLAT, np.ones((3, 3))), "pattern is float64; needs whole numbers"),
        (
            lambda: LayerDeposition().layer(LayerDeposition().start(np.zeros((3, 4))), np.ones((4, 3), np.int32)),
            r"pattern has shape \(4, 3\); needs \(3, 4\)",
        ),
        (lambda: LayerDeposition().layer(FLAT, np.ones((3, 3), int), 1, np.full((3, 3), -0.1)), "at least 0"),
        (lambda: LayerDeposition().layer(FLAT, np.ones((3, 3), int), 1, np.ones((3, 2))), r"shape \(3, 2\)"),
        (lambda: LayerDeposition().start(np.zeros(3)), r"height has shape \(3,\)"),
        (lambda: LayerDeposition(passes=4, pass_rotation=4), "rotated by 0 to 3 places"),
        (lambda: LayerDeposition(passes=4, pass_order=3), "pass_order 3"),
        (lambda: LayerDeposition(((1e-6,) * 3, (1e-6,) * 6)), r"\[3, 6\] numbers by material"),
        (lambda: LayerDeposition(((np.inf, 0.0, 0.0),)), "at least 0 m"),
        (lambda: SuperpositionDeposition(()), "caps has 0 materials"),
        (lambda: SuperpositionDeposition(pitch=0.0), r"pitch is 0\.0; needs a number above 0"),
        (lambda: SuperpositionDeposition().layer(FLAT, np.full((3, 3), 2)), "caps has one material"),
        (lambda: VolumeAreaDeposition().start(np.zeros((3, 3)), np.full((3, 3), -0.1)), "areas of 0 to 1"),
        (lambda: VolumeAreaDeposition().start(np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 2))), "substrate"),
        (lambda: VolumeAreaDeposition(drop_order=4), "drop_order 4"),
        (lambda: VolumeAreaDeposition(cap_radius=-1e-6), "cap_radius -1e-06"),
        (lambda: YoungLaplaceDeposition(cells_per_pitch=65), "2 to 64 points"),
        (lambda: YoungLaplaceDeposition(contact_angle=1.41), "0.02 to 1.4 rad"),
        (lambda: layer_of_many_droplets(40.0), "a droplet of 40 x 3e-14 m3 spreads to a radius of 120.4 µm"),
        (lambda: DropletVolumes(variation=2.0), "0 to 1"),
        (lambda: DropletVolumes(nozzle_variation=-0.1), "nozzle_variation -0.1"),
        (lambda: DropletVolumes(kind=5), "a kind of 1 to 4"),
        (lambda: DropletVolumes(nozzle_pitch=0), "a nozzle at least"),
    ],
)
def test_impossible_arguments_are_refused_with_a_message(attempt, message) -> None:
    with pytest.raises(ValueError, match=message):
        attempt()

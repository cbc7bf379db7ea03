"""The prediction model: C core, CasADi and NumPy are the same map."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.model.layer_model import LayerModel
from support.numpy import lu_numpy

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
GRIDS = [(1, 1), (1, 7), (7, 1), (2, 2), (5, 8), (20, 20)]


def case(shape: tuple[int, int]) -> tuple[Any, Any, Any]:
    rng = np.random.default_rng(shape[0] * 100 + shape[1])
    return rng.uniform(0.0, 12e-6, shape), rng.integers(0, 3, shape, dtype=np.int32), rng.uniform(0.5, 1.0, shape)


def reference(height: Any, pattern: Any, **options: Any) -> Any:
    inks = tuple((ink.h1, ink.h2, ink.h3) for ink in INKS)
    return lu_numpy.layer(height, pattern, inks, **options)[0]


@pytest.mark.parametrize("shape", GRIDS)
def test_core_is_the_layer_map(shape: tuple[int, int]) -> None:
    height, pattern, factor = case(shape)
    expected = reference(height, pattern, factor=factor)
    np.testing.assert_allclose(LayerModel(INKS).layer(height, pattern, factor=factor), expected, rtol=1e-12, atol=0)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("rotation", [0, 1, 3])
def test_four_passes_act_one_on_the_other(order: int, rotation: int) -> None:
    height, pattern, _ = case((5, 8))
    model = LayerModel(INKS, 4, order, rotation)
    for number in (1, 2, 5):
        expected = reference(height, pattern, passes=4, order=order, rotation=rotation, number=number)
        np.testing.assert_allclose(model.layer(height, pattern, number), expected, rtol=1e-12, atol=0)
    assert np.abs(model.layer(height, pattern) - LayerModel(INKS).layer(height, pattern)).max() > 0.1e-6


@pytest.mark.parametrize("shape", GRIDS)
def test_symbolic_map_is_the_layer_map(shape: tuple[int, int]) -> None:
    height, pattern, _ = case(shape)
    material = np.maximum(pattern - 1, 0)
    H, U = ca.MX.sym("H", *shape), ca.MX.sym("U", *shape)
    symbolic = ca.Function("layer", [H, U], [LayerModel(INKS).symbolic(H, U, material)])
    found = np.asarray(symbolic(height, (pattern > 0).astype(float)))
    np.testing.assert_allclose(found, reference(height, pattern), rtol=1e-12, atol=0)


def test_scale_of_the_ink_scales_every_droplet() -> None:
    height, pattern, _ = case((5, 8))
    scaled = LayerModel(INKS).scaled(0.9).layer(height, pattern)
    expected = LayerModel(INKS).layer(height, pattern, factor=np.full((5, 8), 0.9))
    np.testing.assert_allclose(scaled, expected, rtol=1e-12)


@pytest.mark.parametrize(("passes", "order"), [(2, 1), (4, 3)])
def test_passes_that_there_are_not_are_refused(passes: int, order: int) -> None:
    with pytest.raises(ValueError, match="needs 1 or 4 passes in order 1"):
        LayerModel(INKS, passes, order)


def test_pattern_beyond_the_inks_is_refused() -> None:
    with pytest.raises(ValueError, match="needs 0 to 1, the inks given"):
        LayerModel((Ink(),)).layer(np.zeros((2, 2)), np.full((2, 2), 2, np.int32))

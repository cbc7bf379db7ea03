"""The layer map as a linear function of the ink."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.droplet_increments import droplet_increments
from reference import lu_numpy

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))
RNG = np.random.default_rng(5)
HEIGHT = RNG.uniform(0.0, 12e-6, (9, 7))
PATTERN = RNG.integers(0, 3, (9, 7)).astype(np.int32)
FACTOR = RNG.uniform(0.7, 2.0, (9, 7))
TABLE = tuple((ink.h1, ink.h2, ink.h3) for ink in INKS)


@pytest.mark.parametrize("factor", [None, FACTOR])
def test_increments_with_the_same_ink_are_the_layer_map(factor: np.ndarray | None) -> None:
    expected, _ = lu_numpy.one_pass(HEIGHT, PATTERN, TABLE, 1.0 if factor is None else factor)
    added = droplet_increments(HEIGHT, PATTERN, INKS, (), factor).added(INKS)
    np.testing.assert_allclose(added, expected - HEIGHT, rtol=0.0, atol=1e-18)


def test_four_passes_see_the_surface_that_the_last_one_left() -> None:
    expected, _ = lu_numpy.layer(HEIGHT, PATTERN, TABLE, passes=4)
    added = droplet_increments(HEIGHT, PATTERN, INKS, (0, 1, 2, 3)).added(INKS)
    np.testing.assert_allclose(added, expected - HEIGHT, rtol=0.0, atol=1e-18)


def test_variances_of_independent_droplets_add() -> None:
    """With one droplet at a time: the squares of what each adds sum to what the layer reports."""
    alone = np.zeros(HEIGHT.shape)
    for cell in zip(*np.nonzero(PATTERN), strict=True):
        single = np.zeros_like(PATTERN)
        single[cell] = PATTERN[cell]
        alone += droplet_increments(HEIGHT, single, INKS).added(INKS) ** 2
    np.testing.assert_allclose(droplet_increments(HEIGHT, PATTERN, INKS).squares, alone, rtol=1e-12)

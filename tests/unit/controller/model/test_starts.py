"""Plans to begin from: what may not fall never does."""

from __future__ import annotations

from typing import Any

import numpy as np

from inkloop.component import Ink
from inkloop_controller.problem.horizon_problem import HorizonProblem, even_droplets, full_layers, no_droplets

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def problem(choices: Any) -> HorizonProblem:
    """A flat surface of 2 x 2 cells; choices: bits per layer, everywhere the same, or a whole map."""
    maps = np.broadcast_to(np.array(choices, np.uint16).reshape(len(choices), -1, 1), (len(choices), 2, 2)).copy()
    return HorizonProblem(np.zeros((2, 2)), np.full((2, 2), 1e-5), np.ones((2, 2), np.bool_), maps, INKS, 0.8)


def test_full_layers_take_the_first_kind_that_may_fall() -> None:
    plan = full_layers(problem([0, 1, 2, 3]))
    assert plan[:, 0, 0].tolist() == [0, 1, 2, 1]
    assert not no_droplets(problem([3, 3])).any()


def test_even_droplets_are_equal_shares_of_what_lacks_where_droplets_may_fall() -> None:
    of = problem([1, 0, 3, 1])
    of.height[:] = [[0.0, 4e-6], [12e-6, -1.0]]
    shares = np.array([[10 / 4 / 7.6, 6 / 4 / 7.6], [0.0, 1.0]])
    np.testing.assert_allclose(even_droplets(of), shares * np.array([1, 0, 1, 1])[:, None, None], rtol=1e-12)

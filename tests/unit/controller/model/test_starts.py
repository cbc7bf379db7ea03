"""Plans to begin from: what may not fall never does."""

from __future__ import annotations

from typing import Any

import numpy as np

from inkloop.component import Ink
from inkloop_controller.model.starts import even_droplets, full_layers, no_droplets
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support.numpy.plan_starts_numpy import postponed, shifted, squeezed, without_idle_start

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def problem(choices: Any) -> HorizonProblem:
    """A flat surface of 2 x 2 cells; choices: bits per layer, everywhere the same, or a whole map."""
    maps = np.broadcast_to(np.array(choices, np.uint16).reshape(len(choices), -1, 1), (len(choices), 2, 2)).copy()
    return HorizonProblem(np.zeros((2, 2)), np.full((2, 2), 1e-5), np.ones((2, 2), np.bool_), maps, INKS, 0.8)


def layers(*values: int) -> Any:
    return np.broadcast_to(np.array(values, np.int32)[:, None, None], (len(values), 2, 2)).copy()


def test_full_layers_take_the_first_kind_that_may_fall() -> None:
    plan = full_layers(problem([0, 1, 2, 3]))
    assert plan[:, 0, 0].tolist() == [0, 1, 2, 1]
    assert not no_droplets(problem([3, 3])).any()


def test_even_droplets_are_equal_shares_of_what_lacks_where_droplets_may_fall() -> None:
    of = problem([1, 0, 3, 1])
    of.height[:] = [[0.0, 4e-6], [12e-6, -1.0]]
    shares = np.array([[10 / 4 / 7.6, 6 / 4 / 7.6], [0.0, 1.0]])
    np.testing.assert_allclose(even_droplets(of), shares * np.array([1, 0, 1, 1])[:, None, None], rtol=1e-12)


def test_shifted_plan_continues_where_the_last_one_is() -> None:
    assert shifted(layers(0, 1, 2), problem([3, 3, 3]))[:, 0, 0].tolist() == [1, 2, 2]
    assert shifted(layers(1), problem([3]))[:, 0, 0].tolist() == [1]


def test_shifted_plan_leaves_out_what_may_not_fall_any_longer() -> None:
    assert shifted(layers(0, 1, 2), problem([2, 0, 3]))[:, 0, 0].tolist() == [0, 0, 2]


def test_postponed_plan_is_the_rest_of_the_last_one_after_an_empty_layer() -> None:
    assert postponed(layers(2, 1, 1), problem([3, 3, 3]))[:, 0, 0].tolist() == [0, 1, 1]
    assert postponed(layers(2, 1), problem([3, 3, 3]))[:, 0, 0].tolist() == [0, 0, 1]
    assert postponed(layers(2, 1, 2), problem([3, 2, 3]))[:, 0, 0].tolist() == [0, 0, 2]


def test_squeezed_plan_keeps_the_droplets_of_the_layer_left_out_where_there_is_room() -> None:
    assert squeezed(layers(2, 1, 0), problem([3, 3]))[:, 0, 0].tolist() == [1, 2]
    assert squeezed(layers(2, 0, 0), problem([0, 3]))[:, 0, 0].tolist() == [0, 2]
    assert squeezed(layers(2, 1, 1), problem([3, 3]))[:, 0, 0].tolist() == [1, 1]
    assert squeezed(layers(0, 1, 0), problem([3, 3]))[:, 0, 0].tolist() == [1, 0]


def test_droplet_squeezed_into_another_layer_becomes_the_kind_that_may_fall_there() -> None:
    assert squeezed(layers(2, 0, 0), problem([1, 3]))[:, 0, 0].tolist() == [1, 0]
    assert squeezed(layers(0, 2, 2), problem([1, 0]))[:, 0, 0].tolist() == [1, 0]


def test_empty_first_layers_move_to_the_end() -> None:
    free = problem([3, 3, 3])
    assert without_idle_start(layers(0, 0, 1), free)[:, 0, 0].tolist() == [1, 0, 0]
    assert without_idle_start(layers(2, 0, 1), free)[:, 0, 0].tolist() == [2, 0, 1]
    assert not without_idle_start(layers(0, 0, 0), free).any()


def test_droplet_that_moves_to_an_earlier_layer_becomes_the_kind_that_may_fall_there() -> None:
    assert without_idle_start(layers(0, 1), problem([2, 1]))[:, 0, 0].tolist() == [2, 0]
    assert not without_idle_start(layers(0, 1), problem([0, 1])).any()

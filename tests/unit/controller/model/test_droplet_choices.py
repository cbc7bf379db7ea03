"""Droplets allowed on each cell: regions over the horizon, drop sizes, dead nozzles."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink, Job
from inkloop_controller.baseline_planners import nominal_layer_height
from inkloop_controller.core.bindings import split
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model.layer_problems import DropletChoices
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support.closed_loop import block
from support.half_spaces import Below
from support.ink_choices import ink_choices

INKS = (Ink(), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def two_inks(boundary: float) -> Any:
    return block(6, 6, inks=INKS, region=Below(boundary))


def problem(job: Job, horizon: int, inks: Any = INKS[:1], **options: Any) -> HorizonProblem:
    """The problem of the layers on bare ground."""
    mpc = LayerMpc(job, horizon=horizon, choices=DropletChoices(job, **options))
    return mpc.problem(Estimate.exact(np.zeros((job.nx, job.ny)), inks), 0)


def test_one_ink_may_fall_on_the_part_alone() -> None:
    job = block(7, 8)
    allowed = problem(job, 3).choices
    assert allowed.dtype == np.uint16
    assert (allowed == job.mask).all()


@pytest.mark.parametrize(("test", "expected"), [("surface", [1, 1, 2]), ("middle", [1, 2, 2]), ("either", [1, 3, 2])])
def test_regions_of_later_layers_lie_a_nominal_layer_higher_each(test: Any, expected: list[int]) -> None:
    job = two_inks(0.0)
    step = nominal_layer_height(job)
    job = two_inks(1.4 * step)
    assert ink_choices(job, test, np.zeros((6, 6)), 3)[:, 3, 3].tolist() == expected


def test_ends_of_the_layer_are_asked_about_where_either_ink_is_right() -> None:
    step = nominal_layer_height(two_inks(0.0))
    assert (ink_choices(two_inks(0.5 * step), "either", np.zeros((6, 6)), 1) == 3).all()


def test_grey_kinds_are_multiples_of_the_inks() -> None:
    found = problem(two_inks(1.0), 1, INKS, drop_levels=3)
    kinds = found.kinds
    assert len(kinds) == 6
    assert kinds[5] == Ink(3 * INKS[1].h1, 3 * INKS[1].h2, 3 * INKS[1].h3)
    assert found.choices[0, 3, 3] == 0b010101  # ink A in all its sizes
    pattern, level = split(np.array([[0, 1, 2, 5, 6]], np.int32), 2)
    assert pattern.tolist() == [[0, 1, 2, 1, 2]]
    assert level.tolist() == [[1, 1, 1, 3, 3]]


def test_dead_nozzles_jet_nothing_in_any_layer() -> None:
    job = block(8, 9)
    allowed = problem(job, 2, dead_nozzles=(1,), nozzle_pitch=4).choices
    dead = np.arange(9) % 4 == 1
    assert not allowed[:, :, dead].any()
    assert (allowed[:, :, ~dead] == job.mask[:, ~dead]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"drop_levels": 0}, "drop_levels is 0 with 1 inks"),
        ({"drop_levels": 17}, "needs 1 to 16"),
        ({"nozzle_pitch": -1}, "nozzle_pitch is -1"),
        ({"dead_nozzles": (4,), "nozzle_pitch": 4}, "dead_nozzles has 4; needs nozzles 0 to 3"),
    ],
)
def test_what_no_head_has_is_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        DropletChoices(block(), **options)

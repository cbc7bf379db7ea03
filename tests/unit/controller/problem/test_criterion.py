"""The criterion: schedule, ceiling, fringe, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from math import nan
from typing import Any

import numpy as np
import pytest

from inkloop.component import Job
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.criterion import Criterion
from support.closed_loop import block, print_part
from support.long_proofs import rest_is_long


def test_schedule_of_alpha_holds_from_its_layer_on() -> None:
    criterion = Criterion(alpha=[(1, 0.5), (10, 0.9)])
    assert [criterion.alpha_of(layer) for layer in (1, 9, 10, 99)] == [0.5, 0.5, 0.9, 0.9]
    assert Criterion(alpha=0.3).alpha_of(7) == 0.3


def test_ceiling_is_lower_where_the_prediction_is_less_sure() -> None:
    """Of the height now, and of what a full layer of droplets that vary by 10 % adds."""
    target = np.full((1, 2), 100e-6)
    part = np.ones(target.shape, np.bool_)
    job = Job(1, 2, 254e-6, target, part)
    exact, deviation = Estimate.exact(np.zeros((1, 2)), job.inks), np.array([[0.0, 2e-6]])
    estimate = replace(exact, height_variance=deviation**2)
    ceiling = LayerMpc(job, criterion=Criterion(overshoot_limit=5e-6, chance_margin=2.0)).problem(estimate, 0).ceiling
    (ink,) = job.inks
    layer = 0.1 * np.sqrt(ink.h1**2 + 4.0 * ink.h2**2 + 4.0 * ink.h3**2)
    assert ceiling == pytest.approx(105e-6 - 2.0 * np.hypot(deviation, layer), rel=1e-9, abs=0.0)
    assert LayerMpc(job).problem(estimate, 0).ceiling is None


@pytest.mark.system
@pytest.mark.parametrize("prints", rest_is_long([2, 12], 1))
def test_chance_margin_of_two_keeps_the_limit_on_all_but_a_few_cells(prints: int) -> None:
    """A normal prediction is exceeded by 2.3 % of the cells at the limit at two standard deviations, by half of them at
    none."""
    job = block(16, 16)

    def share_above(margin: float) -> float:
        controller = LayerMpcController(job, overshoot_limit_um=0.0, chance_margin=margin, annealing_sweeps=0)
        printed = [print_part(controller, job, variation=0.2, seed=seed) for seed in range(prints)]
        return float(np.mean([(one.height > job.target_height)[job.mask].mean() for one in printed]))

    with_margin, without = share_above(2.0), share_above(0.0)
    assert with_margin < 0.023
    assert without > 0.01 + 2.0 * with_margin


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": 1.5}, "alpha is 1.5"),
        ({"alpha": nan}, "alpha is nan"),
        ({"alpha": [(1, 0.5), (3, -0.5)]}, "alpha is -0.5"),
        ({"alpha": [(3, 0.5), (1, 0.5)]}, "rising layers"),
        ({"alpha": []}, "rising layers"),
        ({"overshoot": 0.0}, "overshoot is 0.0"),
        ({"overshoot_limit": -1e-6}, "overshoot_limit is -1e-06"),
        ({"chance_margin": nan}, "chance_margin is nan"),
        ({"droplet_std": -0.1}, "droplet_std is -0.1"),
        ({"layer_worth": -0.1}, "layer_worth is -0.1"),
        ({"fringe_weight": 2.0}, "fringe_weight is 2.0"),
    ],
)
def test_impossible_options_are_refused(options: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Criterion(**options)


def test_all_errors_are_named_at_once() -> None:
    with pytest.raises(ValueError, match=r"alpha is 2.*overshoot is -1.*fringe_weight is -1"):
        Criterion(alpha=2.0, overshoot=-1.0, fringe_weight=-1.0)

"""The layer controller against the proven optimum of the layer problem (mixed-integer linear program, HiGHS)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.optimize import Bounds, LinearConstraint, milp

from inkloop.component import Ink, Job
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.problem.criterion import Criterion
from support.long_proofs import rest_is_long
from support.numpy import lu_numpy

GAP = 0.005  # of the optimum
MICROMETRE = 1e-6
TWELVE = (100, *range(102, 112))
PROVEN_20 = ((20, 102), (20, 103))  # of the seeds 100 to 103 those that HiGHS proves within a minute


def optimum(height: Any, target: Any) -> float:
    """Least mean |target - height| over all patterns [m], from the NumPy map alone."""
    cells = height.size
    shares = np.zeros((cells, cells))
    for cell in range(cells):
        pattern = np.zeros(cells, np.int64)
        pattern[cell] = 1
        shares[:, cell] = (lu_numpy.one_pass(height, pattern.reshape(height.shape))[0] - height).ravel() / MICROMETRE
    error = (height - target).ravel() / MICROMETRE
    B, identity = sparse.csr_array(shares), sparse.eye_array(cells)
    rows = sparse.vstack([sparse.hstack([B, -identity]), sparse.hstack([-B, -identity])]).tocsr()
    found = milp(
        np.r_[np.zeros(cells), np.full(cells, 1.0 / cells)],
        constraints=LinearConstraint(rows, -np.inf, np.r_[-error, error]),
        integrality=np.r_[np.ones(cells), np.zeros(cells)],
        bounds=Bounds(0.0, np.r_[np.ones(cells), np.full(cells, np.inf)]),
        options={"mip_rel_gap": 1e-6},
    )
    assert found.success, found.message
    return float(found.fun) * MICROMETRE


def gap(n: int, seed: int) -> float:
    """Relative distance of the plan from the optimum on a rough surface with a flat target out of reach."""
    height = np.random.default_rng(seed).uniform(0.0, 8e-6, (n, n))
    target = np.full((n, n), height.mean() + 3.8e-6)
    job = Job(n, n, 263.256e-6, target, np.ones((n, n), np.bool_), (Ink(),))
    planner = LayerMpc(job, criterion=Criterion(alpha=1.0), horizon=1)
    plan = planner.plan(Estimate.exact(height, job.inks), 0, np.zeros((1, n, n), np.int32))
    best = optimum(height, target)
    assert plan.objective.value >= best * (1 - 1e-6)
    return plan.objective.value / best - 1


@pytest.mark.parametrize(
    ("n", "seed"),
    rest_is_long([(7, 100), *((8, seed) for seed in range(100, 106)), *((12, seed) for seed in TWELVE), *PROVEN_20], 1),
)
def test_plan_is_within_half_a_per_cent_of_the_optimum(n: int, seed: int) -> None:
    assert gap(n, seed) <= GAP

"""Our controller, asked for the plan of a single problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from inkloop.component import Job
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LayerPlan
from inkloop_controller.problem.criterion import Criterion
from inkloop_controller.problem.horizon_problem import HorizonProblem
from inkloop_controller.problem.work import Work

PITCH = 1e-4  # [m] of no account


def planned(problem: HorizonProblem, threads: int = 1, **work: float) -> LayerPlan:
    """The plan of `LayerMpc` for a problem as those of `instances`; work: what differs from the default Work."""
    nx, ny = problem.height.shape
    job = Job(nx, ny, PITCH, problem.target, problem.part, problem.kinds)
    budgets = replace(Work(threads=threads), **work)  # type: ignore[arg-type]
    controller = LayerMpc(
        job, criterion=Criterion(alpha=problem.alpha, layer_worth=0.0), horizon=problem.layers, work=budgets
    )
    estimate, no_last_plan = Estimate.exact(problem.height, problem.kinds), np.zeros((1, 0, 0), np.int32)
    return controller.plan(estimate, 0, no_last_plan)

"""The layer problem of the model predictive controller: relaxed, rounded, repaired, and compared."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from math import inf, nan
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import numpy as np

from inkloop.component import FloatMap, Job
from inkloop.errors import InkloopError, require
from inkloop_controller.core.bindings import Device, split
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices, LayerModel, LayerProblems
from inkloop_controller.planning.horizon_planner import Finish, RelaxedStart, best_plan, ending_of
from inkloop_controller.planning.layer_plan import PROVEN, LayerPlan, LeftOut, PlanStatus
from inkloop_controller.problem.criterion import DEFAULT_WORK, PLAIN, Criterion, Stopwatch, Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntMap, IntPlan, SearchProgress, even_droplets
from inkloop_controller.problem.options import declared, default, errors_of, refuse

if TYPE_CHECKING:
    from inkloop_controller.program.program import HorizonProgram
    from inkloop_controller.program.sequential_program import SequentialProgram

_LOG = logging.getLogger(__name__)

DeviceName: TypeAlias = Literal["cpu", "gpu", "auto"]
Relaxation: TypeAlias = Literal["gradient", "slp", "ipopt", "highs", "none"]

CERTIFICATE_S = 60.0  # what a certificate may take if no limit is given (assumed)
SOLVER_SHARE = 0.5  # of a time limit that the relaxation by a solver may take (assumed)


@dataclass(frozen=True, eq=False)
class _Relaxed:
    """Where to round from, and what no plan can be below [m] (NaN: not known)."""

    droplets: RelaxedStart
    bound: float = nan
    left_out: LeftOut = LeftOut.NOTHING


class LayerMpc:
    """Chooses the coming layers that minimise the criterion over the surface after the last of them.

    The search is described in controller/core/planner/horizon_planner.h. Below an alpha of about 0.1 the
    criterion makes no sense: one layer ahead nothing is printed, for the first layer's unevenness costs more than its
    height gains; further ahead a print may end too high. Dead cells are left out, but for a layer now and then in which
    they are tried again.

    finish: how the print ends, "even" (horizon 5) or "fast" (horizon 4, and a layer must gain more to be printed),
    both with horizon 3 where EstimateFigures.is_foreign;
    horizon: layers ahead, 1 to 5, instead of that of `finish`; Criterion.layer_worth stands instead of the other half
    of it; relaxation: its engine, "gradient" of the core, by CasADi "slp" for any horizon, "ipopt" for small grids,
    "highs" for one layer and alpha = 1; device: that repairs plans, "cpu", "gpu" (by OpenCL; layers of one pass, one
    drop size), or "auto", a GPU as long as one can; certified: for one layer and alpha = 1, every plan comes with a
    bound; after_sweep: sees each sweep of a repair, True ends the repairs. Ctrl-C does too, and the plan reports it.
    Raises ValueError for impossible options.
    """

    def __init__(
        self,
        job: Job,
        *,
        criterion: Criterion = PLAIN,
        finish: Annotated[Finish, declared("finish")] = default("finish"),
        horizon: Annotated[int | None, declared("horizon")] = default("horizon"),
        choices: DropletChoices | None = None,
        relaxation: Annotated[Relaxation, declared("relaxation")] = default("relaxation"),
        work: Work = DEFAULT_WORK,
        device: Annotated[DeviceName, declared("device")] = default("device"),
        certified: Annotated[bool, declared("certified")] = default("certified"),
        after_sweep: Callable[[SearchProgress], bool] | None = None,
    ) -> None:
        refuse(errors_of(finish=finish, horizon=horizon, relaxation=relaxation, device=device))
        given, horizon = horizon, ending_of(finish).horizon if horizon is None else horizon
        if certified and (horizon != 1 or criterion.alpha != 1.0):
            raise ValueError(
                f"certified with horizon {horizon} and alpha {criterion.alpha}; a bound needs horizon = 1 and alpha = 1"
            )
        if relaxation == "highs" and (horizon != 1 or criterion.alpha != 1.0 or job.passes != 1):
            raise ValueError(
                f"relaxation is 'highs' with horizon {horizon}, alpha {criterion.alpha} and {job.passes} pass(es) "
                "of a layer; needs horizon = 1, alpha = 1 and 1 pass: set these, or relaxation = 'slp'"
            )
        self.horizon = horizon
        has_bound = certified or relaxation == "highs"  # of the predicted surface
        self._relaxation, self._certified, self._time_limit = relaxation, certified, work.time_limit
        choices = choices or DropletChoices(job)
        self._device = None if device == "cpu" else _device(device, job, choices)
        self._is_device_needed = device == "gpu"
        self._problems = LayerProblems(
            job,
            replace(criterion, droplet_std=0.0) if has_bound else criterion,
            choices,
            threads=work.cores,
            finish=finish,
            horizon=given,
            sweeps_max=work.sweeps,
            annealing_sweeps=work.annealing_sweeps,
            iterations=work.iterations,
        )
        self._after_sweep, self._model = after_sweep, LayerModel.of(job)
        self._programs: dict[tuple[bool, int], HorizonProgram | SequentialProgram] = {}
        if certified:
            import_module("inkloop_controller.program.certificate")  # CasADi, loaded here and not within a time limit
        if relaxation in ("slp", "ipopt", "highs"):
            self._program(self.problem(Estimate.exact(np.zeros((job.nx, job.ny)), job.inks), 0))

    def problem(self, estimate: Estimate, layer: int) -> HorizonProblem:
        """The problem of the layers that follow layer number `layer`. Raises ValueError for what cannot be one."""
        return self._problems.problem(estimate, layer)

    def plan(self, estimate: Estimate, layer: int, last: IntPlan, elapsed: float = 0.0) -> LayerPlan:
        """The best plan found; DONE if that is to print nothing. elapsed: time since the scan [s]."""
        watch, problem = Stopwatch(self._time_limit - elapsed), self.problem(estimate, layer)
        relaxed = self._relaxed(problem, watch)
        find = partial(
            best_plan,
            *(self._problems.step, layer, problem),
            relaxed=relaxed.droplets,
            last=last,
            after_sweep=self._after_sweep,
        )
        try:
            found = find(seconds_max=watch.remaining, device=self._device)
        except InkloopError as error:
            if self._is_device_needed:
                raise
            _LOG.warning("%s; the processor plans from layer %d on", error, layer + 1)
            self._device = None
            found = find(seconds_max=watch.remaining)
        is_uncertified = self._certified and watch.remaining == 0.0
        bound, confidence = self._bound(problem, found.plan, relaxed.bound, watch)
        is_proven = found.objective.value - bound <= PROVEN * problem.kinds[0].layer_height
        return LayerPlan(
            plan=_of_layers(found.plan, self.horizon),
            inks=len(estimate.inks),
            objective=found.objective,
            predict=partial(self._predicted, estimate, found.plan[0], layer + 1),
            status=PlanStatus.OPTIMAL if is_proven and found.status is not PlanStatus.DONE else found.status,
            start=found.start,
            sweeps=found.sweeps,
            bound=bound,
            bound_confidence=confidence,
            seconds={**found.seconds, **watch.seconds},
            left_out=found.left_out | relaxed.left_out | (LeftOut.CERTIFICATE if is_uncertified else LeftOut.NOTHING),
        )

    def _predicted(self, estimate: Estimate, droplets: IntMap, number: int) -> FloatMap:
        """The surface after layer `number` of these droplets of a plan (nx, ny)."""
        pattern, level = split(droplets, len(estimate.inks))
        model = replace(self._model, inks=estimate.inks)
        return model.layer(estimate.height, pattern, number, level.astype(np.float64))

    def _relaxed(self, problem: HorizonProblem, watch: Stopwatch) -> _Relaxed:
        """Where to round from; nowhere if there is no relaxation, or its engine has failed."""
        if self._relaxation in ("gradient", "none"):
            return _Relaxed("gradient" if self._relaxation == "gradient" else None)
        if watch.remaining == 0.0:
            return _Relaxed(even_droplets(problem), left_out=LeftOut.RELAXATION)
        with watch.phase("relaxation"):
            solved = self._program(problem).solve(problem, even_droplets(problem))
        if solved.solved:
            return _Relaxed(solved.droplets, solved.bound)
        is_late = self._time_limit < inf
        usable = solved.droplets if self._relaxation == "slp" else None  # its droplets are never worse than the start
        return _Relaxed(usable, left_out=LeftOut.RELAXATION if is_late else LeftOut.NOTHING)

    def _bound(self, problem: HorizonProblem, plan: IntPlan, proven: float, watch: Stopwatch) -> tuple[float, float]:
        """Lower bound of all plans [m], and the probability that it holds; NaN and 1 if that is not known."""
        if not self._certified or not plan.any() or watch.remaining == 0.0:
            return proven, 1.0
        from inkloop_controller.program.certificate import certify

        with watch.phase("certificate"):
            found = certify(problem, plan, seconds_max=min(CERTIFICATE_S, watch.remaining))
        return (proven, 1.0) if proven >= found.bound else (found.bound, found.confidence)

    def _program(self, problem: HorizonProblem) -> HorizonProgram | SequentialProgram:
        """The program for problems of this shape; built the first time."""
        from inkloop_controller.program.program import HorizonProgram
        from inkloop_controller.program.sequential_program import SequentialProgram

        kind = (problem.alpha == 1.0, problem.layers)  # with alpha 1 the deviation falls out
        if kind not in self._programs:
            seconds_max = SOLVER_SHARE * self._time_limit
            assert self._relaxation in ("slp", "ipopt", "highs")
            self._programs[kind] = (
                SequentialProgram(problem, seconds_max=seconds_max)
                if self._relaxation == "slp"
                else HorizonProgram(problem, self._relaxation, seconds_max=seconds_max)
            )
        return self._programs[kind]


def _device(name: DeviceName, job: Job, choices: DropletChoices) -> Device | None:
    """The search on a device; None where "auto" finds none. Raises ValueError for "gpu" where it cannot be."""
    reasons = [f"layers of {job.passes} passes"] * (job.passes > 1)
    reasons += [f"{choices.drop_levels} drop sizes"] * (choices.drop_levels > 1)
    try:
        if reasons:
            raise InkloopError(f"{' and '.join(reasons)} are planned on the processor")
        require("pyopencl", "it")
        search: Device = import_module("inkloop_controller.gpu.search").DeviceSearch()
        return search
    except InkloopError as error:
        if name == "gpu":
            raise ValueError(f"device is 'gpu', and {error}; set device = 'cpu' or 'auto'") from error
        _LOG.info("the processor plans: %s", error)
        return None


def _of_layers(plan: IntPlan, layers: int) -> IntPlan:
    """With empty layers after its own; the plan itself where it has as many."""
    return plan if len(plan) == layers else np.pad(plan, ((0, layers - len(plan)), (0, 0), (0, 0)))

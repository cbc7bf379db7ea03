"""A time limit leaves out stages and still gives a plan: a second passes at every look at the stopwatch."""

from __future__ import annotations

import ctypes
import shutil
import sys
from collections.abc import Callable, Iterator
from functools import cache, partial
from math import inf

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.core import bindings
from inkloop_controller.core.library import VARIABLE, library
from inkloop_controller.planning.horizon_planner import FoundPlan
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.criterion import Work
from inkloop_controller.problem.horizon_problem import HorizonProblem, no_droplets
from support import compiled
from support.fmus.controller_values import controller_values
from support.places import ROOT
from support.problem_plans import best_plan

CORE = ROOT / "controller" / "core"
ELSEWHERE = ("parallel_pthread.c", "stopwatch.c")
SOURCES = (
    *(path for path in sorted(CORE.rglob("*.c")) if path.name not in ELSEWHERE),
    ROOT / "fmus" / "layer_deposition" / "layer_map.c",
    ROOT / "tests" / "c" / "counting_stopwatch.c",
)
PLACES = sorted({f"-I{path.parent}" for path in (*CORE.rglob("*.h"), *SOURCES, ROOT / "fmus/deposition/pass_colour.h")})
FLAGS = ("-std=c11", "-O1", "-ffp-contract=off", "-fPIC", *PLACES)
ALL = LeftOut.RELAXATION | LeftOut.STARTS | LeftOut.REPAIR | LeftOut.FEWER_LAYERS
FIRST_PLAN = 32.0  # looks at the stopwatch, with two evaluations and a rounding
ENDING = 12.0  # looks after the time has ended: of stages that find none left
EVALUATION = 72.0  # looks, of a plan of 384 x 16 cells and three layers: a repair ends with one
WORK = Work(sweeps=4, annealing_sweeps=0, iterations=3)

pytestmark = [
    pytest.mark.compiled,
    pytest.mark.skipif(sys.platform != "linux" or not shutil.which("gcc"), reason="gcc for Linux is not installed"),
]


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The core with the counting stopwatch."""
    flags = (*FLAGS, f"-I{controller_values()}")
    objects = [compiled.object_of(source, flags) for source in SOURCES]
    monkeypatch.setenv(VARIABLE, str(compiled.linked("counting_core.so", objects, ("-shared",))))
    library.cache_clear()
    yield
    library.cache_clear()


def problem(shape: tuple[int, int] = (14, 13)) -> HorizonProblem:
    """Little is lacking, and unevenly: fewer layers than the horizon's are worth a try."""
    height = np.random.default_rng(3).uniform(0.0, 8e-6, shape)
    target, everywhere = np.full(height.shape, height.mean() + 12e-6), np.ones(height.shape, np.bool_)
    return HorizonProblem(height, target, everywhere, np.ones((3, *height.shape), np.uint16), (Ink(),), 0.8)


def found(limit: float, of: HorizonProblem | None = None) -> FoundPlan:
    of = of or problem()
    last = np.random.default_rng(4).integers(0, 2, of.choices.shape, dtype=np.int32)
    return best_plan(of, WORK, last=last, layer_worth=0.001, seed=1, seconds_max=limit)


def looks() -> float:
    """Number of looks at the stopwatch so far, this one included."""
    look = library().stopwatch_seconds
    look.restype = ctypes.c_double
    return float(look())


def same(left: FoundPlan, right: FoundPlan) -> bool:
    outcome = [(plan.objective, plan.status, plan.start, plan.sweeps, plan.left_out) for plan in (left, right)]
    return outcome[0] == outcome[1] and np.array_equal(left.plan, right.plan)


def test_limit_that_does_not_take_effect_changes_no_bit(request: pytest.FixtureRequest) -> None:
    usual = found(inf)
    request.getfixturevalue("counting")
    assert same(found(inf), usual)
    assert same(found(1e9), usual)
    assert usual.left_out == LeftOut.NOTHING


@pytest.mark.usefixtures("counting")
def test_plan_without_time_is_sound_and_reports_what_was_left_out() -> None:
    plan = found(0.0)
    assert (plan.status, plan.sweeps, plan.left_out) == (PlanStatus.FALLBACK, 0, ALL)
    assert plan.plan[0].any()
    assert plan.objective.value < bindings.objective(problem(), no_droplets(problem())).value


@cache
def found_and_taken() -> tuple[list[FoundPlan], list[float]]:
    """For each limit of 0 to 400 looks: the plan, and the looks that it took beyond the limit."""
    plans, taken = [], []
    for limit in range(0, 400, 2):
        began = looks()
        plans.append(found(float(limit)))
        taken.append(looks() - began - limit)
    return plans, taken


@pytest.mark.usefixtures("counting")
def test_every_limit_gives_a_plan_better_than_nothing_and_more_time_leaves_out_less() -> None:
    nothing = bindings.objective(problem(), no_droplets(problem())).value
    plans, _ = found_and_taken()
    for plan in plans:
        assert plan.plan[0].any()
        assert plan.objective == bindings.objective(problem(), plan.plan)
        assert plan.objective.value < nothing
        assert (plan.status in (PlanStatus.FALLBACK, PlanStatus.TIME_LIMIT)) <= bool(plan.left_out & LeftOut.REPAIR)
    for stage in ALL:
        first = next(index for index, plan in enumerate(plans) if not plan.left_out & stage)
        assert 0 < first < len(plans)
    assert plans[-1].left_out == LeftOut.NOTHING
    whole = found(inf)
    assert all(same(plan, whole) for plan in plans if plan.left_out == LeftOut.NOTHING)


@pytest.mark.usefixtures("counting")
def test_each_stage_reports_itself_what_it_left_out() -> None:
    """Whatever the others report: a start after its repair, and the stages of a shorter plan, not of the first one."""
    plans, _ = found_and_taken()
    assert any(plan.left_out == ALL & ~LeftOut.REPAIR for plan in plans)
    assert any(plan.left_out == ALL & ~LeftOut.FEWER_LAYERS for plan in plans)
    last = np.ones((3, 14, 13), np.int32)
    even = best_plan(problem(), WORK, relaxed=None, last=last, layer_worth=0.001, seed=1, seconds_max=0.0)
    assert even.left_out == ALL & ~LeftOut.RELAXATION


@pytest.mark.usefixtures("counting")
def test_time_beyond_the_limit_is_that_of_the_first_sound_plan_at_most() -> None:
    _, taken = found_and_taken()
    assert taken[0] == max(taken) == FIRST_PLAN


@pytest.mark.usefixtures("counting")
def test_more_time_gives_no_worse_plan_than_none() -> None:
    """The best of the first plans begins with an empty layer, which takes an evaluation more than full layers."""
    last = np.zeros((0, 14, 13), np.int32)
    values = [
        best_plan(problem(), WORK, last=last, layer_worth=0.001, seed=1, seconds_max=limit).objective.value
        for limit in np.arange(0.0, 40.0, 2.0)
    ]
    assert max(values) == values[0]


def looks_after_hold_up(after: float, make: Callable[[], FoundPlan]) -> tuple[FoundPlan, float]:
    """A plan during which the machine is held up after so many looks, and the looks from there on."""
    core = library()
    core.stopwatch_looks.restype = ctypes.c_double
    core.hold_up_after.argtypes = (ctypes.c_double,)
    began = core.stopwatch_looks()
    core.hold_up_after(after)
    plan = make()
    core.hold_up_after(inf)
    return plan, core.stopwatch_looks() - began - after


@pytest.mark.usefixtures("counting")
def test_whatever_is_under_way_ends_with_the_time() -> None:
    tall = problem((384, 16))
    nothing = bindings.objective(tall, no_droplets(tall)).value
    first, whole = (looks_after_hold_up(0.0, partial(found, limit, tall))[1] for limit in (1.0, inf))
    for after in range(0, int(whole), 20):
        plan, late = looks_after_hold_up(float(after), partial(found, 1e5, tall))
        ending = ENDING + (EVALUATION if LeftOut.STARTS in plan.left_out else 0.0)
        assert plan.objective.value < nothing
        assert late <= max(first - after, ending)


@pytest.mark.usefixtures("counting")
def test_rest_of_the_last_plan_that_is_cut_off_while_it_is_postponed_is_reported() -> None:
    """Put off, the rest is the best of these starts, so a plan from another one is there because time was lacking."""
    last = np.ones((3, 14, 13), np.int32)
    make = partial(best_plan, problem(), WORK, relaxed=None, last=last, layer_worth=0.0, seed=1, seconds_max=1e5)
    plans = [looks_after_hold_up(float(after), make)[0] for after in range(40)]
    unrepaired = [plan for plan in plans if plan.status is PlanStatus.FALLBACK]
    assert {plan.start for plan in unrepaired} == {"full layers", "last plan"}
    assert all(LeftOut.STARTS in plan.left_out for plan in unrepaired)

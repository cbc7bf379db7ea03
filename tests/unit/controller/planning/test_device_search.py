"""The repair of plans on an OpenCL device: as good as the core's, repeatable, refused by name, and replaced."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from math import inf
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from benchmarks import on_device as on_device_benchmark
from rich.table import Table

from inkloop.component import Ink
from inkloop.errors import InkloopError
from inkloop.testing import job
from inkloop.units import UM_PER_M
from inkloop_controller.controllers import LayerMpcController
from inkloop_controller.core.bindings import objective
from inkloop_controller.core.layer_step import LayerStep
from inkloop_controller.core.library import CORE_TIME, SearchOptionsStruct, problem_struct
from inkloop_controller.estimation.height_estimator import Estimate
from inkloop_controller.model import DropletChoices
from inkloop_controller.planning.horizon_planner import FoundPlan, best_plan
from inkloop_controller.planning.layer_mpc import LayerMpc
from inkloop_controller.planning.layer_plan import LeftOut, PlanStatus
from inkloop_controller.problem.horizon_problem import HorizonProblem, IntPlan
from support.closed_loop import block, print_part
from support.core_search import search
from support.extras import sentence
from support.layer_problems import nearly_flat, random_plan, rough, with_everything

cl = pytest.importorskip("pyopencl", reason="needs OpenCL: pip install 'inkloop[gpu]'")
device = pytest.importorskip("inkloop_controller.gpu.device")
if not device.devices():
    pytest.skip("needs an OpenCL device: pip install pocl-binary-distribution", allow_module_level=True)
from inkloop_controller.gpu import plan_on_device  # noqa: E402
from inkloop_controller.gpu.plan_on_device import BETWEEN_LAYERS, IN_A_LAYER  # noqa: E402
from inkloop_controller.gpu.search import DeviceSearch  # noqa: E402

SORTS = IN_A_LAYER, BETWEEN_LAYERS
PROBLEMS = {
    "one layer": rough((13, 21)),
    "deviation": nearly_flat((21, 13), 2, alpha=0.8),
    "deviation, far below the target": replace(nearly_flat((13, 21), 2, alpha=0.3), target=np.full((13, 21), 3e-3)),
    "chance": nearly_flat((17, 23), 3, droplet_std=0.06, overshoot=1.07),
    "two sizes": replace(
        nearly_flat((17, 23), 1, droplet_std=0.4),
        kinds=(Ink(0.9e-6, 0.12e-6, 0.04e-6), Ink()),
        choices=np.full((1, 17, 23), 3, np.uint16),
    ),
    "everything": with_everything((23, 17), 2, 1, 5, droplet_std=0.06),
}


@pytest.fixture(scope="module", autouse=True)
def any_device() -> Iterator[None]:
    """The first device, which may be a processor, stands in for a GPU."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(device.CHOICE, "0")
        yield


@pytest.fixture(scope="module")
def on_device(any_device: None) -> DeviceSearch:
    return DeviceSearch()


def found_by(searching: DeviceSearch | None, problem: HorizonProblem, **options: Any) -> FoundPlan:
    step = LayerStep(job(), layer_worth=0.0)
    nothing = np.zeros((0, *problem.height.shape), np.int32)
    return best_plan(step, 3, problem, **{"last": nothing, "seconds_max": inf, **options}, device=searching)


@pytest.mark.parametrize("name", PROBLEMS)
def test_surfaces_are_kept_up_to_date_to_the_last_bit(name: str, on_device: DeviceSearch) -> None:
    """After a sweep of moves they are those of the plan, printed again."""
    problem = PROBLEMS[name]
    struct, plan = problem_struct(problem), random_plan(problem, 1)
    surface = on_device.plan(struct, plan)
    surface.wake()
    for sort in SORTS[: len(plan)]:
        assert list(surface.sweep(sort))
        assert surface.made
    surface.read_plan(plan)
    kept = surface.read_heights()
    np.testing.assert_array_equal(kept, on_device.plan(struct, plan).read_heights())
    np.testing.assert_array_equal(kept[0], np.rint(problem.height * 2.0**54) / 2.0**54)  # the lattice of the core


def changed_plans(plan: IntPlan, problem: HorizonProblem, sort: int, layer: int, i: int, j: int) -> Iterator[IntPlan]:
    """By each move of a cell: another value, a swap with a neighbour to the right or below; a droplet's other layer."""
    here, (layers, nx, ny) = (layer, i, j), plan.shape
    if sort == BETWEEN_LAYERS:
        others = [(later, i, j) for later in range(layer + 1, layers)]
    else:
        yield from (at(plan, {here: value}) for value in range(len(problem.kinds) + 1))
        places = [(i + di, j + dj) for di, dj in ((0, 1), (1, -1), (1, 0), (1, 1))]
        others = [(layer, k, m) for k, m in places if k < nx and 0 <= m < ny]
    yield from (at(plan, {here: plan[other], other: plan[here]}) for other in others)


def at(plan: IntPlan, values: dict[tuple[int, int, int], Any]) -> IntPlan:
    changed = plan.copy()
    for place, value in values.items():
        changed[place] = value
    return changed


@pytest.mark.parametrize(
    "problem",
    [rough((7, 9)), nearly_flat((21, 16), 3, droplet_std=0.06), with_everything((8, 9), 2, 1, 5, alpha=1.0)],
    ids=["one layer", "three layers", "everything"],
)
def test_sweep_makes_the_best_move_of_each_cell(
    problem: HorizonProblem, on_device: DeviceSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the objective of the core, on cells that do not meet from the same plan. Of equal moves any may be made."""
    monkeypatch.setattr(plan_on_device, "LAUNCHES_A_LOOK", 1)
    plan, (layers, nx, ny) = random_plan(problem, 1), problem.choices.shape
    surface = on_device.plan(problem_struct(problem), plan)
    surface.wake()
    allowed, least = 2 * problem.choices.astype(np.int32) + 1, 1e-5 * Ink().h1 / problem.part.sum()
    for sort in SORTS[:layers]:
        launches = surface.sweep(sort)
        for layer in reversed(range(layers - (sort == BETWEEN_LAYERS))):
            period = 2 * (layers - layer) + (4 if sort == IN_A_LAYER else 2)
            for ci, cj in np.ndindex(min(period, nx), min(period, ny)):
                gains = 0.0
                value = objective(problem, plan).value
                for i, j in ((i, j) for i in range(ci, nx, period) for j in range(cj, ny, period)):
                    trials = changed_plans(plan, problem, sort, layer, i, j)
                    found = [objective(problem, each).value for each in trials if (allowed >> each & 1).all()]
                    gains += min(*found, value, value) - value
                next(launches)
                surface.read_plan(plan)
                assert objective(problem, plan).value - value == pytest.approx(gains, rel=1e-3, abs=10.0 * least)
        assert not list(launches)


@pytest.mark.parametrize("name", PROBLEMS)
def test_plan_is_the_same_where_a_group_takes_many_cells(
    name: str, on_device: DeviceSearch, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = PROBLEMS[name]
    found = found_by(on_device, problem)
    monkeypatch.setattr(plan_on_device, "LEAST_GROUPS", 2)
    np.testing.assert_array_equal(found_by(on_device, problem).plan, found.plan)


@pytest.mark.parametrize("name", PROBLEMS)
def test_core_finds_no_better_move_and_the_plan_repeats(name: str, on_device: DeviceSearch) -> None:
    problem = PROBLEMS[name]
    found, again = (found_by(on_device, problem) for _ in range(2))
    assert found.status is PlanStatus.REPAIRED
    np.testing.assert_array_equal(found.plan, again.plan)
    assert found.objective == objective(problem, found.plan)
    tried = search(problem, found.plan, sweeps_max=2)
    assert tried.objective.value > found.objective.value - 2e-3 * Ink().h1 / problem.part.sum()


@pytest.mark.parametrize("alpha", [0.5, 0.0])
def test_moves_made_together_do_not_worsen_the_plan(alpha: float, on_device: DeviceSearch) -> None:
    """Each of two moves alone would bring the two cells of the part closer, both together further apart."""
    problem, start = rough((1, 25), 2, alpha=alpha), np.zeros((2, 1, 25), np.int32)
    ends = np.zeros((1, 25), np.bool_)
    ends[0, [0, -1]] = True
    height = np.where(np.arange(25) == 24, -0.4 * Ink().h1, 0.0).reshape(1, 25)
    choices = (np.arange(2).reshape(2, 1, 1) * ends).astype(np.uint16)
    problem = replace(problem, height=height, target=height * 0.0, part=ends, choices=choices)
    start[1, 0, 24] = 1
    plan = start.copy()
    options = SearchOptionsStruct(sweeps_max=1, seconds_max=inf)
    on_device.improve(problem_struct(problem), options, plan, lambda _: False)
    assert objective(problem, plan).value <= objective(problem, start).value


@pytest.mark.parametrize("name", PROBLEMS)
def test_plan_is_as_good_as_that_of_the_core(name: str, on_device: DeviceSearch) -> None:
    problem = PROBLEMS[name]
    assert found_by(on_device, problem).objective.value < 1.04 * found_by(None, problem).objective.value


@pytest.mark.long
def test_thirty_plans_are_as_good_as_those_of_the_core(on_device: DeviceSearch) -> None:
    problems = [
        problem
        for seed in range(6)
        for problem in (
            rough((40, 31), 1, seed),
            nearly_flat((31, 40), 2, seed, droplet_std=0.06, overshoot=1.07),
            nearly_flat((40, 30), 3, seed, alpha=0.8),
            nearly_flat((30, 40), 4, seed, droplet_std=0.06),
            nearly_flat((30, 35), 5, seed),
        )
    ]
    excess = [found_by(on_device, one).objective.value / found_by(None, one).objective.value - 1.0 for one in problems]
    assert np.mean(excess) < 0.01, excess


@pytest.mark.parametrize("name", ["target", "weight", "part", "choices", "ceiling", "height"])
def test_map_that_changes_between_layers_is_sent_again(name: str, on_device: DeviceSearch) -> None:
    """Maps stay on the device; a plan on them is that of a device that knows none."""
    slope, before = np.linspace(0.0, 4e-6, 13)[:, None], with_everything((13, 11), 2, 1, 5)
    assert before.ceiling is not None
    before = replace(before, target=before.target + slope, ceiling=before.ceiling + slope)  # turned over they differ
    changed = getattr(before, name)[..., ::-1, :]
    found_by(on_device, before)
    kept = found_by(on_device, replace(before, **{name: changed}))
    on_device.maps.release()
    np.testing.assert_array_equal(kept.plan, found_by(on_device, replace(before, **{name: changed})).plan)


def test_sixty_layers_take_the_memory_of_one_and_send_heights_and_plans_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    part, rng, cells = block(9, 7, 3e-5), np.random.default_rng(2), 9 * 7
    planner, last = LayerMpc(part, device="gpu", horizon=3), np.zeros((0, 9, 7), np.int32)
    improve, buffer = DeviceSearch.improve, cl.Buffer
    taken: list[int] = []
    sent: dict[int, list[int]] = {1: [], 2: [], 3: []}

    def watched(search: DeviceSearch, problem: Any, *given: Any) -> tuple[int, int]:
        before = search.maps.sent
        found = improve(search, problem, *given)
        sent[problem.layers].append(search.maps.sent - before)
        return found

    def take(*given: Any) -> Any:
        taken.append(given[-1])
        return buffer(*given)

    monkeypatch.setattr(DeviceSearch, "improve", watched)
    monkeypatch.setattr(cl, "Buffer", take)
    for layer in range(60):
        height = part.target_height - rng.uniform(0.8, 2.5, (9, 7)) * Ink().layer_height
        last = planner.plan(Estimate.exact(height, part.inks), layer, last).plan
        if layer == 0:
            taken.append(0)
    assert len(sent[3]) == 60
    assert taken[-1] == 0  # none after those of the first layer
    first, *rest = sent[3]
    assert first - min(rest) == cells * (8 + 1 + 3 * 2)  # target, part, choices
    assert np.median(rest) == min(rest)


def test_time_limit_and_ctrl_c_end_the_search(on_device: DeviceSearch) -> None:
    problem = nearly_flat((12, 15), 3)
    late = found_by(on_device, problem, seconds_max=1e-9)
    assert (late.status, late.left_out & LeftOut.REPAIR) == (PlanStatus.FALLBACK, LeftOut.REPAIR)
    plan = random_plan(problem, 1)
    options = SearchOptionsStruct(sweeps_max=30, seconds_max=0.0)
    assert on_device.improve(problem_struct(problem), options, plan, lambda _: False) == (CORE_TIME, 1)

    def interrupt(_: object) -> bool:
        raise KeyboardInterrupt

    options, start = SearchOptionsStruct(sweeps_max=30, seconds_max=inf), plan.copy()
    with pytest.raises(KeyboardInterrupt):
        on_device.improve(problem_struct(problem), options, plan, interrupt)
    assert objective(problem, plan).value < objective(problem, start).value
    stopped = found_by(on_device, problem, after_sweep=interrupt)
    assert (stopped.status, stopped.sweeps) == (PlanStatus.INTERRUPTED, 1)


@pytest.mark.parametrize(
    ("options", "passes", "reason"),
    [({}, 4, "layers of 4 passes"), ({"drop_levels": 2}, 1, "2 drop sizes")],
    ids=["four passes", "grey head"],
)
def test_what_the_device_does_not_plan_is_refused_or_planned_here(
    options: dict[str, Any], passes: int, reason: str
) -> None:
    part = replace(block(8, 7, 3e-5), passes=passes)
    choices = DropletChoices(part, **options)
    with pytest.raises(ValueError, match=f"{reason} are planned on the processor; set device = 'cpu' or 'auto'"):
        LayerMpc(part, device="gpu", choices=choices)
    assert LayerMpc(part, device="auto", choices=choices)._device is None


def test_processor_takes_over_where_a_device_is_lost(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def lost(*_: object) -> None:
        with device.device_errors("the GPU"):
            raise cl.RuntimeError("out of resources")

    part, height = block(9, 8, 1.1e-5), np.random.default_rng(1).uniform(0.0, 8e-6, (9, 8))
    planners = [LayerMpc(part, device=name) for name in ("cpu", "auto", "gpu")]
    monkeypatch.setattr(DeviceSearch, "improve", lost)
    task = (Estimate.exact(height, part.inks), 0, np.zeros((0, 9, 8), np.int32))
    here, taken_over = (planner.plan(*task) for planner in planners[:2])
    np.testing.assert_array_equal(taken_over.plan, here.plan)
    assert "the GPU has failed (out of resources)" in caplog.text
    assert "from layer 1 on" in caplog.text
    with pytest.raises(InkloopError, match="plan on the processor with device = 'cpu'"):
        planners[2].plan(*task)


@pytest.mark.parametrize(
    ("reason", "failing"),
    [
        ("out of resources", {"_program": None}),
        ("takes 0.0 GiB", {"_device": SimpleNamespace(global_mem_size=1, max_mem_alloc_size=1)}),
    ],
    ids=["lost", "too little memory"],
)
def test_print_goes_on_where_a_device_fails_in_it(
    reason: str, failing: dict[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    part = block(9, 8, 4e-5)
    controller = LayerMpcController(part, device="auto", horizon=2)
    improve, plans = DeviceSearch.improve, []

    def lost(_: object) -> None:
        raise cl.RuntimeError("out of resources")

    def failing_later(search: DeviceSearch, *given: Any) -> tuple[int, int]:
        plans.append(given)
        for name, value in failing.items() if len(plans) == 3 else ():
            monkeypatch.setattr(search, name, value or lost)
        return improve(search, *given)

    monkeypatch.setattr(DeviceSearch, "improve", failing_later)
    ours = print_part(controller, part, variation=0.2).errors_um(part)
    assert len(plans) == 3
    assert reason in caplog.text
    assert max(map(abs, ours)) < 0.2 * Ink().layer_height * UM_PER_M


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv(device.CHOICE)
    monkeypatch.setattr(device, "devices", lambda: [])
    device.chosen_device.cache_clear()
    yield
    device.chosen_device.cache_clear()


def test_benchmark_compares_the_device_with_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(on_device_benchmark, "HORIZONS", (1, 2))
    table = on_device_benchmark.measure((12,))
    assert isinstance(table, Table)
    ours, cores = ([float(str(text)) for text in table.columns[number].cells] for number in (6, 4))
    assert ours == pytest.approx(cores, rel=0.1, abs=0.0)


def test_layers_of_a_print_are_planned_as_well_as_by_the_core(monkeypatch: pytest.MonkeyPatch) -> None:
    """Droplets that move between layers from the first sweep on end 1 to 4 % higher."""
    monkeypatch.setattr(on_device_benchmark, "HORIZONS", (2, 3))
    table = on_device_benchmark.measure((60,))
    assert isinstance(table, Table)
    ours, cores = (np.array([str(text) for text in table.columns[k].cells], np.float64) for k in (6, 4))
    assert np.mean(ours / cores) < 1.005


@pytest.mark.usefixtures("no_gpu")
def test_machine_without_a_gpu_says_so() -> None:
    assert "no GPU here" in str(on_device_benchmark.measure())
    with pytest.raises(ValueError, match=r"no GPU here, but no OpenCL device at all; .* device = 'cpu'"):
        LayerMpc(block(5, 4, 1e-5), device="gpu")
    assert LayerMpc(block(5, 4, 1e-5), device="auto")._device is None
    assert "no GPU here" in device.lines()[-1]


def test_errors_of_a_device_are_a_line_with_what_to_do(on_device: DeviceSearch) -> None:
    """The first error of a log of the compiler; missing memory of this machine."""
    program = cl.Program(on_device._queue.context, "kernel void f(global int *a) { a[0] = b; }\n" * 9)
    line = r"^X has failed \(clBuild[^\n]*identifier 'b'\); plan .* 'cpu'[^\n]*$"
    with pytest.raises(InkloopError, match=line), device.device_errors("X"):
        program.build()
    with pytest.raises(InkloopError, match=r"^X has failed \(no memory\)"), device.device_errors("X"):
        raise MemoryError


def test_broken_driver_hides_no_device_and_single_precision_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> None:
        raise cl.RuntimeError("the driver is broken")

    found = SimpleNamespace(type=cl.device_type.GPU, name="G", global_mem_size=1, extensions="cl_khr_fp16")
    working = SimpleNamespace(name="P", get_devices=lambda: [found])
    found.platform = working
    monkeypatch.setattr(cl, "get_platforms", lambda: [SimpleNamespace(get_devices=broken), working])
    monkeypatch.delenv(device.CHOICE)
    assert device.devices() == [found]
    with pytest.raises(InkloopError, match=r"G .* has no double precision"):
        device.chosen_device.__wrapped__()


def test_plan_that_does_not_fit_the_device_is_refused(on_device: DeviceSearch) -> None:
    problem = problem_struct(nearly_flat((5, 6), 3))
    problem.nx = problem.ny = 1 << 20
    with pytest.raises(InkloopError, match=r"a plan with horizon 3 of 1048576 x 1048576 cells takes .* GiB"):
        on_device._check_memory(problem)


def test_whole_print_on_a_device_ends_as_even() -> None:
    part = block(24, 19, 3e-5)
    planned = (LayerMpcController(part, device=name, horizon=2) for name in ("gpu", "cpu"))
    ours, cores = (print_part(controller, part, variation=0.2).errors_um(part) for controller in planned)
    assert ours[1:] == pytest.approx(cores[1:], rel=0.25, abs=0.0)


def test_missing_opencl_is_named_with_its_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyopencl", None)
    with pytest.raises(ValueError, match=re.escape(f"device is 'gpu', and it {sentence('pyopencl')}")):
        LayerMpc(block(5, 4, 1e-5), device="gpu")
    assert LayerMpc(block(5, 4, 1e-5), device="auto")._device is None

"""The repair of a plan on an OpenCL device: the best moves of cells that do not meet, all at once (moves.cl)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import pyopencl as cl

from inkloop_controller.core.library import CORE_BUDGET, CORE_DONE, CORE_STOPPED, CORE_TIME
from inkloop_controller.gpu.device import DeviceError, chosen_device, described, device_errors
from inkloop_controller.gpu.maps import DeviceMaps
from inkloop_controller.gpu.plan_on_device import BETWEEN_LAYERS, GROUP, IN_A_LAYER, TEAM, PlanOnDevice, has_ceiling
from inkloop_controller.problem.horizon_problem import IntPlan

FIRST = 4
"""Sweeps of moves in a layer before droplets move between layers: all moves from the first on end 1 to 4 % higher."""
FORM = ("LAYERS", "KINDS", "CEILING", "WEIGHT", "DEVIATION")


class DeviceSearch:
    """The search on one device; problems of the same form share their program.

    It ends when no move near a change improves the plan, for alpha < 1 by a bound that moves made together keep: no
    sweep worsens the plan. The same problem gives the same plan on a device. Raises DeviceError where there is no
    device, where it fails, or where it lacks memory.
    """

    def __init__(self) -> None:
        self._device = chosen_device()
        self._name = described(self._device)
        with device_errors(self._name):
            self._queue = cl.CommandQueue(cl.Context([self._device]))
        self._programs: dict[tuple[int, ...], cl.Program] = {}
        self.maps = DeviceMaps(self._queue, (0, 0))

    def improve(self, problem: Any, options: Any, plan: IntPlan, after_sweep: Callable[[int], bool]) -> tuple[int, int]:
        """Improve a plan as inkloop_controller.core.bindings.Device says."""
        ends_at = perf_counter() + options.seconds_max
        with device_errors(self._name):
            self._check_memory(problem)
            surface = self.plan(problem, plan)
            try:
                return _sweeps(surface, options.sweeps_max, ends_at, after_sweep)
            finally:  # after Ctrl-C too
                surface.read_plan(plan)

    def plan(self, problem: Any, plan: IntPlan) -> PlanOnDevice:
        """The plan and its surfaces on the device, in place of the last one."""
        shape = problem.nx, problem.ny
        if self.maps.shape != shape:
            self.maps.release()
            self.maps = DeviceMaps(self._queue, shape)
        return PlanOnDevice(self.maps, self._program(problem), problem, plan)

    def _program(self, problem: Any) -> cl.Program:
        form = (problem.layers, problem.kinds, has_ceiling(problem), bool(problem.weight), problem.alpha < 1.0)
        if form not in self._programs:
            names = dict(zip(FORM, map(int, form), strict=True), GROUP=GROUP, TEAM=TEAM)
            source = Path(__file__).with_name("moves.cl").read_text(encoding="utf-8")
            flags = [f"-D{name}={value}" for name, value in names.items()]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", cl.CompilerWarning)  # some compilers always say something
                self._programs[form] = cl.Program(self._queue.context, source).build(flags)
        return self._programs[form]

    def _check_memory(self, problem: Any) -> None:
        cells, layers = (problem.nx + 2) * (problem.ny + 2), problem.layers
        needed = cells * (8 * (layers + 5) + 4 * layers + 1)
        if needed > self._device.global_mem_size or 8 * cells * (layers + 1) > self._device.max_mem_alloc_size:
            raise DeviceError(
                f"a plan with horizon {layers} of {problem.nx} x {problem.ny} cells takes {needed / 2**30:.1f} GiB, in "
                f"pieces of {8 * cells * (layers + 1) / 2**30:.1f} GiB, and {self._name} gives pieces of "
                f"{self._device.max_mem_alloc_size / 2**30:.1f} GiB; shorten the horizon, or plan with device = 'cpu'"
            )


def _sweeps(
    surface: PlanOnDevice, sweeps_max: int, ends_at: float, after_sweep: Callable[[int], bool]
) -> tuple[int, int]:
    sorts = min(surface.layers, 2)
    sort, idle, is_whole = IN_A_LAYER, 0, True
    surface.wake()
    for sweep in range(1, sweeps_max + 1):
        for _ in surface.sweep(sort):
            if perf_counter() > ends_at:
                return CORE_TIME, sweep
        idle = 0 if surface.made else idle + 1
        is_whole = is_whole and idle > 0
        if idle == sorts:
            if is_whole or not surface.has_deviation:
                return CORE_DONE, sweep
            surface.wake()  # any move changes the deviation of all: moves that slept are tried once more
            idle, is_whole = 0, True
        if after_sweep(sweep):
            return CORE_STOPPED, sweep
        is_next = sort == IN_A_LAYER and sorts == 2 and (sweep >= FIRST or idle)
        sort = BETWEEN_LAYERS if is_next else IN_A_LAYER
    return CORE_BUDGET, sweeps_max

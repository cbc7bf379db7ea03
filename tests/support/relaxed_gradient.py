"""The smoothed objective of the core and its gradient, which the core computes for its own descent only."""

from __future__ import annotations

import ctypes

import numpy as np

from inkloop.component import FloatMap
from inkloop_controller.core.bindings import checked, pointer, problem_struct
from inkloop_controller.problem.horizon_problem import HorizonProblem
from support import compiled
from support.places import C_SOURCES, ROOT

CORE = ROOT / "controller" / "core"
FOLDERS = (
    *(CORE / group for group in ("problem", "model", "relaxation")),
    *(ROOT / "fmus" / group for group in ("deposition", "layer_deposition")),
)
SOURCES = (
    *(CORE / "problem" / f"{name}.c" for name in ("parallel_pthread", "stopwatch")),
    *(CORE / "relaxation" / f"{name}.c" for name in ("relaxed_flow", "relaxed_surface")),
    C_SOURCES / "relaxed_gradient.c",
)
FLAGS = ("-std=c11", "-O2", "-ffp-contract=off", *(f"-I{folder}" for folder in FOLDERS))


def relaxed_gradient(problem: HorizonProblem, droplets: FloatMap, smoothing: float) -> tuple[float, FloatMap]:
    """Smoothed objective [m] of droplets (layers, nx, ny), and its gradient (layers, nx, ny) [m per droplet].

    smoothing s [m]: max(x, 0) becomes (x + sqrt(x^2 + s^2)) / 2, the standard deviation sqrt(variance + s^2).
    """
    function = compiled.library("relaxed_gradient.so", SOURCES, FLAGS).smoothed_objective
    function.restype = ctypes.c_bool
    given = checked("droplets", droplets, "f8", problem.choices.shape)
    value, gradient, struct = ctypes.c_double(), np.empty(given.shape), problem_struct(problem)
    numbers = (pointer(given), ctypes.c_double(smoothing), ctypes.byref(value), pointer(gradient))
    assert function(ctypes.byref(struct), *numbers)
    return value.value, gradient

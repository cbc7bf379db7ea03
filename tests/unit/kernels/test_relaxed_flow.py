"""Flow of droplets of any size, and its adjoint: the same bits by every set of instructions, and those of a plain loop.

The plain loop goes from droplet to droplet and adds to their neighbours; the core goes from cell to cell.
"""

from __future__ import annotations

import ctypes
import itertools
from functools import cache
from typing import Any

import numpy as np
import pytest

from inkloop.contract import pass_colour
from inkloop_controller.core.library import ProblemStruct
from support.compiled import BUILDS, library
from support.long_proofs import rest_is_long
from support.places import ROOT

CORE = ROOT / "controller" / "core"
FOLDERS = tuple(CORE / group for group in ("relaxation", "model", "problem"))
FOLDERS += tuple(ROOT / "fmus" / group for group in ("deposition", "layer_deposition"))
SOURCES = (CORE / "relaxation" / "relaxed_flow.c", CORE / "problem" / "stopwatch.c")
INKS = ((4.4e-6, 0.6e-6, 0.2e-6), (3.9e-6, 0.5e-6, 0.1e-6), (2.1e-6, 0.2e-6, 0.0))
NO_KIND = 255  # of drop_levels.h
ALL = -1
NEIGHBOURS = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
SIZE, REAL = ctypes.c_size_t, ctypes.c_double
REALS, BYTES = ctypes.POINTER(REAL), ctypes.POINTER(ctypes.c_uint8)

pytestmark = pytest.mark.compiled


class Footprint(ctypes.Structure):
    """`Footprint` of relaxed_flow.h."""

    _fields_ = (("h1", REAL), ("spread", REAL * 2), ("steepness", REAL * 2))

    @classmethod
    def of(cls, ink: tuple[float, float, float]) -> Footprint:
        """Of h1, h2 and h3 [m]."""
        h1, *spread = ink
        return cls(h1, (REAL * 2)(*spread), (REAL * 2)(*(1.0 / (h1 + part) for part in spread)))


class RelaxedStep(ctypes.Structure):
    """`RelaxedStep` of relaxed_flow.h."""

    _fields_ = (
        *(("problem", ctypes.POINTER(ProblemStruct)), ("kind", ctypes.POINTER(Footprint)), ("first", BYTES)),
        *(("droplets", REALS), ("colour", ctypes.c_int32), ("ends_at", REAL), ("before", REALS)),
    )


class Case:
    """A random step: any size about that of a band of 128 columns, flat or rough, in one pass or the pass of a colour.

    Maps have a frame: the surface an infinitely low one, what the objective feels one of 0.
    """

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.shape = (int(rng.integers(1, 9)), int(rng.choice([1, 2, 3, 7, 127, 128, 129, 130, 260])))
        self.inks = INKS[: 1 + seed % 3]
        rough = (0.0, 1e-7, 8e-6, 1e-3)[seed % 4]
        self.before = np.pad(rng.uniform(0.0, rough, self.shape), 1, constant_values=-np.inf)
        self.later = np.pad(rng.normal(size=self.shape), 1)
        self.droplets = np.where(rng.random(self.shape) < 0.2, 0.0, rng.uniform(0.0, 2.0, self.shape))
        self.first = rng.choice([*range(len(self.inks)), NO_KIND], self.shape).astype(np.uint8)
        self.colour = int(rng.integers(4)) if seed % 2 else ALL


def of(array: Any) -> Any:
    """The pointer to an array that C reads or writes."""
    return array.ctypes.data_as(BYTES if array.dtype == np.uint8 else REALS)


def compiled_library(build: str) -> ctypes.CDLL:
    flags = ("-std=c11", *BUILDS[build], *(f"-I{folder}" for folder in FOLDERS))
    loaded = library("relaxed_flow.so", SOURCES, flags)
    for function in (loaded.jet_rows, loaded.trace_rows):
        function.restype = ctypes.c_bool
    return loaded


def step_of(it: Case, ends_at: float = np.inf) -> RelaxedStep:
    problem = ProblemStruct(nx=it.shape[0], ny=it.shape[1], kinds=len(it.inks))
    kinds = (Footprint * len(it.inks))(*map(Footprint.of, it.inks))
    maps = (of(it.first), of(it.droplets), it.colour, ends_at, of(it.before))
    return RelaxedStep(ctypes.pointer(problem), kinds, *maps)


def calculated(build: str, it: Case) -> list[Any]:
    """The surface after the step, what is felt before it, and what of the droplets; in two parts, as by two threads."""
    loaded, step, nx = compiled_library(build), step_of(it), it.shape[0]
    after, earlier, gradient = it.before.copy(), np.zeros_like(it.later), np.full(it.shape, 7.0)
    for top, bottom in ((0, nx // 2), (nx // 2, nx)):
        rows = (ctypes.byref(step), SIZE(top), SIZE(bottom))
        assert loaded.jet_rows(*rows, of(after))
        assert loaded.trace_rows(*rows, of(it.later), of(earlier), of(gradient))
    return [after, earlier, gradient]


def plain(it: Case) -> list[Any]:
    """The same, droplet by droplet."""
    after, earlier, gradient = it.before.copy(), it.later.copy(), np.full(it.shape, 7.0)
    for i, j in itertools.product(*map(range, it.shape)):
        if it.colour not in (ALL, pass_colour(i, j)):
            continue
        gradient[i, j] = 0.0
        if it.first[i, j] == NO_KIND:
            continue
        (h1, *spread), amount, cell = it.inks[it.first[i, j]], float(it.droplets[i, j]), (i + 1, j + 1)
        kept, gain = 0.0, h1 * float(it.later[cell])
        for di, dj in NEIGHBOURS:
            other, part = (cell[0] + di, cell[1] + dj), spread[1 if di and dj else 0]
            steepness, rise = 1.0 / (h1 + part), float(it.before[cell] - it.before[other])
            share = max(1.0 + min(rise, 0.0) * steepness, 0.0)
            ahead = part * float(it.later[other] - it.later[cell])
            after[other] += amount * (part * share)
            kept += part - part * share
            gain += part * float(it.later[cell]) + share * ahead
            if rise < 0.0 and share > 0.0:
                earlier[cell] += amount * steepness * ahead
                earlier[other] -= amount * steepness * ahead
        after[cell] += amount * (h1 + kept)
        gradient[i, j] = gain
    return [after, earlier, gradient]


@cache
def plain_bits(seed: int) -> list[bytes]:
    return [array.tobytes() for array in plain(Case(seed))]


@pytest.mark.parametrize("build", rest_is_long(BUILDS, 1))
def test_bits_are_those_of_a_plain_loop(build: str) -> None:
    """By AVX2 where the processor has it, by the instructions of every x86-64, and however gcc optimises."""
    found = {seed: [array.tobytes() for array in calculated(build, Case(seed))] for seed in range(48)}
    assert [seed for seed, each in found.items() if each != plain_bits(seed)] == []


def test_rows_end_when_the_time_does() -> None:
    loaded, it = compiled_library("as shipped"), Case(1)
    rows = (ctypes.byref(step_of(it, ends_at=-1.0)), SIZE(0), SIZE(it.shape[0]))
    assert not loaded.jet_rows(*rows, of(it.before.copy()))
    assert not loaded.trace_rows(*rows, of(it.later), of(it.later.copy()), of(it.droplets.copy()))

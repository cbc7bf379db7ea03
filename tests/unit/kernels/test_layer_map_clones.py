"""The layer map and its derivatives give the same bits by every set of instructions, and those of a plain loop."""

from __future__ import annotations

import ctypes
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from inkloop.contract import pass_colour
from support.compiled import BUILDS, library
from support.long_proofs import rest_is_long
from support.places import ROOT

CORE = ROOT / "controller" / "core"
FOLDERS = (ROOT / "fmus" / "deposition", ROOT / "fmus" / "layer_deposition", CORE / "model", CORE / "problem")
PARALLEL = tuple(CORE / "problem" / name for name in ("row_ranges.c", "parallel_pthread.c"))
SOURCES = (FOLDERS[1] / "layer_map.c", CORE / "model" / "droplet_increments.c", *PARALLEL)
INKS = ((4.4e-6, 0.6e-6, 0.2e-6), (3.9e-6, 0.5e-6, 0.1e-6))
NEIGHBOURS = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
ALL = -1
SIZE, REAL = ctypes.c_size_t, ctypes.c_double
REALS, INTEGERS = ctypes.POINTER(REAL), ctypes.POINTER(ctypes.c_int32)

pytestmark = pytest.mark.compiled


class JettedLayer(ctypes.Structure):
    """`JettedLayer` of droplet_increments.h."""

    _fields_ = (
        *(("nx", SIZE), ("ny", SIZE), ("pattern", INTEGERS), ("factor", REALS)),
        *(("passes", ctypes.c_int32), ("order", INTEGERS), ("threads", SIZE)),
    )


class DropletIncrements(ctypes.Structure):
    """`DropletIncrements` of droplet_increments.h."""

    _fields_ = (("unit", REALS), ("adds", REALS), ("squares", REALS), ("own", REALS))


@dataclass(frozen=True)
class Case:
    """Droplets on a surface (nx, ny) [m]; factor: None or the volume of each."""

    height: Any
    pattern: Any
    factor: Any
    inks: Any
    colours: tuple[int, ...]


def case(seed: int) -> Case:
    """A random one: any size about that of a band of 128 columns, flat or rough, with cells, inks and parts of 0."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in (rng.integers(1, 9), rng.choice([1, 2, 3, 7, 127, 128, 129, 130, 260])))
    height = rng.uniform(0.0, (0.0, 1e-7, 8e-6, 1e-3)[seed % 4], shape)
    height[rng.random(shape) < 0.03] = -0.0
    factor = np.where(rng.random(shape) < 0.1, 0.0, rng.uniform(0.6, 1.4, shape)) if seed % 3 else None
    pattern = rng.integers(0, 3, shape) if seed % 5 else np.ones(shape)
    pattern[rng.random(shape[0]) < 0.2] = 0
    inks = np.array(INKS)
    inks[rng.integers(2), rng.integers(3)] *= seed % 7 != 0
    inks[1] *= seed % 11 != 0
    colours = tuple(int(colour) for colour in rng.permutation(4)) if seed % 2 else (ALL,)
    return Case(height, pattern.astype(np.int32), factor, inks, colours)


def of(array: Any) -> Any:
    """The pointer to an array that C reads; None stays None."""
    kind = INTEGERS if array is not None and array.dtype == np.int32 else REALS
    return None if array is None else array.ctypes.data_as(kind)


def compiled_library(build: str) -> ctypes.CDLL:
    flags = ("-std=c11", *BUILDS[build], *(f"-I{folder}" for folder in FOLDERS))
    loaded = library("layer_map.so", SOURCES, flags)
    loaded.deposit_pass.restype = REAL
    return loaded


def surfaces(loaded: ctypes.CDLL, it: Case) -> list[Any]:
    """The surface after every pass, and what was lost in it."""
    after, found = it.height.copy(), []
    for colour in it.colours:
        before = after.copy()
        arguments = (SIZE(after.shape[0]), SIZE(after.shape[1]), of(it.pattern), of(it.inks), of(it.factor), colour)
        lost = loaded.deposit_pass(of(before), of(after), *arguments)
        found += [after.copy(), np.array(lost)]
    return found


def increments(loaded: ctypes.CDLL, it: Case, inks: int = 2, unit: Any = None) -> list[Any]:
    """Increments, their squares and the cell's own share, of the whole layer; and the surface after it."""
    nx, ny = it.height.shape
    after = np.zeros_like(it.height)
    adds, squares, own, scratch = (np.full((n, nx, ny), np.nan) for n in (3 * inks if unit is None else inks, 1, 1, 2))
    order = np.array(it.colours, np.int32)
    layer = JettedLayer(nx, ny, of(it.pattern), of(it.factor), len(order), of(order), 1)
    maps = DropletIncrements(of(unit), of(adds), of(squares), of(own))
    call = (of(it.height), SIZE(inks), of(it.inks), of(scratch))
    loaded.droplet_increments(ctypes.byref(layer), *call, ctypes.byref(maps), of(after))
    return [adds, squares[0], own[0], after]


def share(rise: float, width: float) -> float:
    return 1.0 if rise >= 0.0 else 0.0 if rise <= -width else 1.0 + rise / width


def droplets(it: Case, colour: int) -> list[tuple[int, int, float]]:
    """Cells of a colour that are jetted, in order, with the volume."""
    nx, ny = it.height.shape
    return [
        (i, j, 1.0 if it.factor is None else float(it.factor[i, j]))
        for i, j in itertools.product(range(nx), range(ny))
        if it.pattern[i, j] and colour in (ALL, pass_colour(i, j))
    ]


def plain_surfaces(it: Case) -> list[Any]:
    """`surfaces`, droplet by droplet (Lu, Zheng, Mishra 2015, equations 3 to 7)."""
    after, found = it.height.copy(), []
    nx, ny = after.shape
    for colour in it.colours:
        before, lost = after.copy(), 0.0
        for i, j, volume in droplets(it, colour):
            h1, h2, h3 = (float(h) * volume for h in it.inks[it.pattern[i, j] - 1])
            kept = left = 0.0
            for di, dj in NEIGHBOURS:
                part = h3 if di and dj else h2
                if not (0 <= i + di < nx and 0 <= j + dj < ny):
                    left += part
                    continue
                taken = part * share(float(before[i, j] - before[i + di, j + dj]), h1 + part)
                after[i + di, j + dj] += taken
                kept += part - taken
            after[i, j] += h1 + kept
            lost += left
        found += [after.copy(), np.array(lost)]
    return found


def plain_increments(it: Case) -> list[Any]:
    """`increments`, droplet by droplet."""
    nx, ny = it.height.shape
    rates, squares, own = np.zeros((6, nx, ny)), np.zeros((nx, ny)), np.zeros((nx, ny))
    passes = [it.height, *plain_surfaces(it)[::2]]
    for before, colour in zip(passes, it.colours, strict=False):
        for i, j, volume in droplets(it, colour):
            ink = it.pattern[i, j] - 1
            heights = [float(h) for h in it.inks[ink]]
            kept = [volume, 0.0, 0.0]
            for di, dj in NEIGHBOURS:
                if not (0 <= i + di < nx and 0 <= j + dj < ny):
                    continue
                order, cell = (2 if di and dj else 1), (i + di, j + dj)
                part = heights[order] * volume
                of_part = share(float(before[i, j] - before[cell]), heights[0] * volume + part)
                kept[order] += volume - of_part * volume
                rates[3 * ink + order][cell] += of_part * volume
                squares[cell] += of_part * part * (of_part * part)
            left = heights[0] * kept[0] + heights[1] * kept[1] + heights[2] * kept[2]
            rates[3 * ink : 3 * ink + 3, i, j] += kept
            squares[i, j] += left * left
            own[i, j] += left
    return [rates, squares, own, passes[-1]]


def bits(arrays: list[Any]) -> list[bytes]:
    return [array.tobytes() for array in arrays]


@cache
def plain_bits(plain: Callable[[Case], list[Any]], seed: int) -> list[bytes]:
    return bits(plain(case(seed)))


@pytest.mark.parametrize("build", rest_is_long(BUILDS, 1))
@pytest.mark.parametrize(
    ("calculated", "plain"), [(surfaces, plain_surfaces), (increments, plain_increments)], ids=["surface", "increments"]
)
def test_bits_are_those_of_a_plain_loop(build: str, calculated: Callable[..., Any], plain: Callable[..., Any]) -> None:
    """By AVX2 where the processor has it, by the instructions of every x86-64, and however gcc optimises."""
    loaded = compiled_library(build)
    assert [seed for seed in range(12) if bits(calculated(loaded, case(seed))) != plain_bits(plain, seed)] == []


@pytest.mark.parametrize("inks", [1, 2])
def test_increments_of_volumes_are_the_rates_in_the_proportions_of_their_unit(inks: int) -> None:
    """Of inks that are the unit but for their volume; of one ink alone they are taken from the surface."""
    loaded, unit = compiled_library("as shipped"), np.array(INKS)
    for seed in range(24):
        drawn = case(seed)
        pattern = np.minimum(drawn.pattern, inks).astype(np.int32)
        it = replace(drawn, pattern=pattern, inks=np.array([[0.8], [1.3]]) * unit)
        rates, *others = increments(loaded, it)
        adds, *same = increments(loaded, it, inks, unit)
        stated = np.einsum("ko,koij->kij", unit, rates.reshape(2, 3, *pattern.shape))[:inks]
        np.testing.assert_allclose(adds, stated, rtol=1e-9, atol=1e-17, err_msg=str(seed))
        for found, expected in zip(same, others, strict=True):
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-24, err_msg=str(seed))

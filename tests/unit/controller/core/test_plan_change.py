"""Invariants of incremental evaluation inside the search core, by a program in C that reads its internal headers."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from support.compiled import EXACT, library, program
from support.places import C_SOURCES, ROOT

CORE = ROOT / "controller" / "core"
FMUS = ROOT / "fmus"
SEARCH = ("change_bound", "near_flow", "one_step", "one_step_cells", "plan_change", "plan_surface")
PROGRAMS = {
    "plan_change_invariants": SEARCH,
    "one_step_invariants": (*SEARCH, "flip_bounds", "flip_costs", "one_step_sweep", "tile_moves", "tiled_sweep"),
}
SHARED = (
    *(CORE / "problem" / f"{name}.c" for name in ("map_memory", "objective", "parallel_none", "row_ranges")),
    FMUS / "layer_deposition" / "layer_map.c",
)
FOLDERS = (*(CORE / group for group in ("problem", "model", "search")), FMUS / "layer_deposition", FMUS / "deposition")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")
SANITIZED = ("-fsanitize=address,undefined", "-fno-sanitize-recover=all")
BUILDS = {
    "sanitized": ("-O1", "-g", "-ffp-contract=off", *SANITIZED),
    "sanitized, without clones": ("-O1", "-g", "-ffp-contract=off", *SANITIZED, "-DINKLOOP_BASELINE"),
    "as shipped": ("-O3", *EXACT),
    "without clones": ("-O3", *EXACT, "-DINKLOOP_BASELINE"),
}

pytestmark = pytest.mark.compiled


def checked(name: str, build: str) -> subprocess.CompletedProcess[str]:
    flags = ("-std=c11", *BUILDS[build], *WARNINGS, *(f"-I{folder}" for folder in FOLDERS))
    searched = (CORE / "search" / f"{source}.c" for source in PROGRAMS[name])
    made = program(name, (C_SOURCES / f"{name}.c", *searched, *SHARED), flags)
    return subprocess.run([made], capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", PROGRAMS)
@pytest.mark.parametrize(
    "builds", [("as shipped", "without clones"), pytest.param(tuple(BUILDS), marks=pytest.mark.long)]
)
def test_changes_are_exact_leave_no_trace_and_have_the_same_bits_by_every_set_of_instructions(
    builds: tuple[str, ...], name: str
) -> None:
    """Also: the surfaces are those of the layer map, and nothing reads or writes outside its arrays."""
    found = {build: checked(name, build) for build in builds}
    assert {build: done.stdout + done.stderr for build, done in found.items() if done.returncode} == {}
    assert len({done.stdout for done in found.values()}) == 1


SOURCE = ROOT / "controller" / "core" / "problem" / "median.c"
MEDIAN_FLAGS = ("-std=c11", "-O2", f"-I{ROOT / 'controller' / 'core' / 'problem'}", f"-I{ROOT / 'fmus' / 'deposition'}")
SAMPLED = 1024  # values; from here on limits are drawn from a sample (median.c)
CHUNKS = 32  # of the rows of a grid (row_ranges.h)
REALS = ctypes.POINTER(ctypes.c_double)


def sample_size(count: int) -> int:
    """As in median.c, but for few values, of which all are looked at: 1."""
    sizes = [2**k for k in range(6, 12) if 8**k <= 2 * count**2]
    return sizes[-1] if count >= SAMPLED else 1


DRAWN: dict[str, Callable[[np.random.Generator, int], Any]] = {
    "normal": lambda rng, count: rng.normal(size=count),
    "ascending": lambda rng, count: np.sort(rng.normal(size=count)),
    "equal": lambda rng, count: np.full(count, 3e-6),
    "few values": lambda rng, count: rng.integers(0, 3, count).astype(float),
    "two heaps": lambda rng, count: np.where(np.arange(count) % 2 == 0, 1e-6, 2e-6) + 1e-9 * rng.normal(size=count),
    "a sample that misleads": lambda rng, count: (
        np.where(np.arange(count) % (count // sample_size(count)) == 0, 9.0, 1.0) * rng.random(count)
    ),
}


class ValueLists(ctypes.Structure):
    """`ValueLists` of median.h."""

    _fields_ = (("nx", ctypes.c_size_t), ("ny", ctypes.c_size_t), ("map", REALS), ("lengths", ctypes.c_size_t * CHUNKS))


@pytest.mark.parametrize("drawn", DRAWN)
def test_it_is_that_of_the_sorted_values(drawn: str) -> None:
    """Of an array, and of lists that chunks of rows left in a map, some of them empty."""
    core, rng = library("median.so", [SOURCE], MEDIAN_FLAGS), np.random.default_rng(5)
    core.median.restype = core.median_of_lists.restype = ctypes.c_double
    for count in (1, 2, 3, 10, 11, SAMPLED - 1, SAMPLED, SAMPLED + 1, 8 * SAMPLED + 7, 100 * SAMPLED):
        values = DRAWN[drawn](rng, count)
        expected = np.sort(values)[(count - 1) // 2 : count // 2 + 1].mean()
        lists, room, _kept = listed(rng, values)
        assert core.median_of_lists(ctypes.byref(lists), room.ctypes.data_as(REALS)) == expected, count
        given = np.ascontiguousarray(values)
        assert core.median(given.ctypes.data_as(REALS), ctypes.c_size_t(count)) == expected, count


def listed(rng: np.random.Generator, values: Any) -> tuple[ValueLists, Any, Any]:
    """The values in lists of a map of 40 rows, room for as many, and the map; behind a list stand no numbers."""
    weights = rng.random(CHUNKS) * (rng.random(CHUNKS) < 0.7) + 1e-9
    ends = np.rint(np.cumsum(weights) / weights.sum() * len(values)).astype(int)
    nx, ny = 40, len(values)
    places = np.full((nx, ny), np.nan)
    lists = ValueLists(nx, ny, places.ctypes.data_as(REALS))
    for chunk, (begin, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        places.reshape(-1)[nx * chunk // CHUNKS * ny :][: end - begin] = values[begin:end]
        lists.lengths[chunk] = end - begin
    return lists, np.empty_like(places), places

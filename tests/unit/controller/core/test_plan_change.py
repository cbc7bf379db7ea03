"""Invariants of incremental evaluation inside the search core, by a program in C that reads its internal headers."""

from __future__ import annotations

import subprocess

import pytest

from support.compiled import EXACT, program
from support.places import C_SOURCES, ROOT

CORE = ROOT / "controller" / "core"
FMUS = ROOT / "fmus"
SEARCH = ("change_bound", "near_flow", "one_step", "one_step_cells", "plan_change", "plan_surface")
PROGRAMS = {
    "plan_change_invariants": SEARCH,
    "one_step_invariants": (*SEARCH, "flip_bounds", "flip_costs", "one_step_sweep", "tile_moves", "tiled_sweep"),
}
SHARED = (
    *(CORE / "problem" / f"{name}.c" for name in ("map_memory", "objective", "parallel_none")),
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

"""Invariants of incremental evaluation inside the search core, by a program in C that reads its internal headers."""

from __future__ import annotations

import subprocess

import pytest

from support.compiled import program
from support.places import C_SOURCES, ROOT

CORE = ROOT / "controller" / "core"
FMUS = ROOT / "fmus"
SOURCES = (
    C_SOURCES / "plan_change_invariants.c",
    *(CORE / f"{name}.c" for name in ("search/plan_change", "search/plan_surface", "problem/objective")),
    FMUS / "layer_deposition" / "layer_map.c",
)
FLAGS = ("-std=c11", "-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")

pytestmark = pytest.mark.compiled


def test_changes_are_exact_and_leave_no_trace_when_tried_or_undone() -> None:
    """Also: the surfaces are those of the layer map, and nothing reads or writes outside its arrays."""
    folders = (
        *(CORE / group for group in ("problem", "model", "search")),
        FMUS / "layer_deposition",
        FMUS / "deposition",
    )
    checked = subprocess.run(
        [program("plan_change_invariants", SOURCES, (*FLAGS, *WARNINGS, *(f"-I{folder}" for folder in folders)))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr

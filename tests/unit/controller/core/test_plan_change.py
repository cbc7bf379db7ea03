"""Laws of incremental evaluation inside the search core, by a program in C that reads its internal headers."""

from __future__ import annotations

import subprocess

import pytest

from support.compiled import program
from support.places import C_SOURCES, ROOT

CORE = ROOT / "controller" / "core"
LAYER_MAP = ROOT / "fmus" / "layer_deposition"
SOURCES = (
    C_SOURCES / "plan_change_laws.c",
    *(CORE / f"{name}.c" for name in ("search/plan_change", "search/plan_surface", "problem/objective")),
    LAYER_MAP / "layer_map.c",
)
FLAGS = ("-std=c11", "-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Werror")

pytestmark = pytest.mark.compiled


def test_changes_are_exact_and_leave_no_trace_when_tried_or_undone() -> None:
    """Also: the surfaces are those of the layer map, and nothing reads or writes beside its arrays."""
    places = (*(f"-I{CORE / group}" for group in ("problem", "model", "search")), f"-I{LAYER_MAP}")
    laws = subprocess.run(
        [program("plan_change_laws", SOURCES, (*FLAGS, *WARNINGS, *places))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert laws.returncode == 0, laws.stdout + laws.stderr

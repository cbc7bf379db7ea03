"""Invariants of the C code of columns under sanitizers, by a program in C that reads its internal headers."""

from __future__ import annotations

import subprocess

import pytest

from support.compiled import program
from support.places import C_SOURCES, ROOT

FOLDER = ROOT / "cosim" / "columns"
SOURCES = (C_SOURCES / "column_invariants.c", *sorted(FOLDER.glob("*.c")))
FLAGS = ("-std=c11", "-O1", "-g", "-ffp-contract=off", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
WARNINGS = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")

pytestmark = pytest.mark.compiled


def test_random_triangles_and_intervals_keep_the_invariants_of_columns() -> None:
    """Also: nothing reads or writes outside its arrays, or leaks; triangles that are no numbers are survived."""
    checked = subprocess.run(
        [program("column_invariants", SOURCES, (*FLAGS, *WARNINGS, f"-I{FOLDER}"))],
        capture_output=True,
        text=True,
        check=False,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr

"""Who may import whom, and through which door each library comes in."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from support.places import ROOT

FLOOR = {
    f"inkloop.{name}"
    for name in ("component", "errors", "contract", "units", "geometry", "files", "suggest", "testing")
}
BUILD_TIME = {
    f"inkloop.fmu_writer{name}"
    for name in ("", ".definition", ".description", ".c_tables", ".documentation", ".archive", ".export", ".windows")
}
DOORS = {
    "fmpy": ("inkloop.fmu",),
    "casadi": ("inkloop_controller",),
    "can": ("inkloop_hardware",),
    "cantools": ("inkloop_hardware",),
    "isotp": ("inkloop_hardware",),
    "udsoncan": ("inkloop_hardware",),
    "e2e": ("inkloop_hardware",),
    "tifffile": ("inkloop.metrology",),
    "sdfio": ("inkloop.metrology",),
    "SurfaceTopography": ("inkloop.metrology",),
    "skfem": ("inkloop.studies.reproduce.finite_elements",),
    "matplotlib": (
        *("inkloop.report.plot", "inkloop.report.run_report", "inkloop.report.model_difference"),
        *(
            "inkloop.identify.picture",
            "inkloop.exchange.job.target_picture",
            "inkloop.studies.reproduce",
            "inkloop.studies.score",
        ),
    ),
    "mpl_toolkits": (
        "inkloop.report.plot",
        "inkloop.report.run_report",
        "inkloop.studies.reproduce",
        "inkloop.studies.score",
    ),
}


def modules() -> Iterator[tuple[str, Path]]:
    for root in (ROOT / "cosim", ROOT / "controller", ROOT / "hardware"):
        for path in sorted(root.rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            yield ".".join(parts[:-1] if parts[-1] == "__init__" else parts), path


def imported(path: Path) -> set[str]:
    """Every module that a file imports, at its top or inside a function."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.add(node.module or "")
            found.update(f"{node.module}.{alias.name}" for alias in node.names if node.module == "inkloop")
    return found


MODULES = list(modules())
EVERY_MODULE = pytest.mark.parametrize(("name", "path"), MODULES, ids=[name for name, _ in MODULES])


def is_below(module: str, package: str) -> bool:
    return module == package or module.startswith(f"{package}.")


@EVERY_MODULE
def test_each_library_comes_in_by_one_door(name: str, path: Path) -> None:
    for library, doors in DOORS.items():
        if any(is_below(name, door) for door in doors):
            continue
        assert not [found for found in imported(path) if is_below(found, library)]


@EVERY_MODULE
def test_floor_and_build_time_modules_stand_on_little(name: str, path: Path) -> None:
    if name not in FLOOR | BUILD_TIME:
        return
    allowed = set(sys.stdlib_module_names) | ({"numpy"} if name in FLOOR else set())
    own = FLOOR if name in FLOOR else BUILD_TIME | {"inkloop.errors", "inkloop.files"}
    for found in imported(path) - {"inkloop", "inkloop.__version__"}:
        assert found.split(".")[0] in allowed or found in own or found.rpartition(".")[0] in own, found


@EVERY_MODULE
@pytest.mark.parametrize("package", ["inkloop_controller", "inkloop_hardware"])
def test_controller_and_hardware_stand_on_the_floor_only(package: str, name: str, path: Path) -> None:
    found = {module for module in imported(path) if is_below(module, "inkloop")} - {"inkloop"}
    if is_below(name, package):
        assert found <= FLOOR
    else:
        assert not [module for module in imported(path) if is_below(module, package)]


def test_kernels_know_no_fmi_type() -> None:
    sources = [path for path in (ROOT / "fmus").rglob("*.[ch]") if path.parent.name not in ("common", "fuzz")]
    sources += (ROOT / "controller" / "core").rglob("*.[ch]")
    sources += (ROOT / "hardware" / "firmware").rglob("*.[ch]")
    assert sources
    for source in sources:
        text = source.read_text(encoding="utf-8")
        assert not re.search(r"#\s*include\s*[<\"]fmi\d", text), source
        assert not re.search(r"\bfmi[23][A-Z]\w*", text), source


def test_firmware_stands_on_no_operating_system() -> None:
    """node/ and can/: a microcontroller without one runs the same files, and nothing is allocated."""
    allowed = {"stdbool.h", "stddef.h", "stdint.h", "string.h"}
    firmware = ROOT / "hardware" / "firmware"
    sources = sorted([*(firmware / "node").glob("*.[ch]"), *(firmware / "can").glob("*.[ch]")])
    assert sources
    for source in sources:
        text = source.read_text(encoding="utf-8")
        assert set(re.findall(r"#\s*include\s*<(.*?)>", text)) <= allowed, source
        assert not re.search(r"\b(malloc|calloc|realloc|free)\s*\(", text), source

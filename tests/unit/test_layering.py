"""Rules of imports: between packages, of each library, and the number of names at each root."""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterable
from pathlib import Path

from support.places import ROOT
from support.source_tree import (
    PACKAGES,
    c_files,
    c_unit,
    circles,
    grouped,
    import_graph,
    imported,
    include_graph,
    is_below,
    modules,
    parsed,
    public_names,
    room,
)

ON_THE_FLOOR = "component", "component_errors", "contract", "errors", "files", "geometry", "limits", "testing", "units"
FLOOR = {f"inkloop.{name}" for name in ON_THE_FLOOR}
READERS = ("inkloop.geometry.three_mf", "inkloop.geometry.ply_file")
"""Modules of the floor that bring a library in; they are imported by name, for a file of their format."""
FLOOR |= {name for name in modules() if is_below(name, "inkloop.geometry")} - {*READERS}
BUILD_TIME = "inkloop.fmu_writer"
"""These modules run while the FMUs are built, when nothing else is installed."""
BUILD_TIME_FLOOR = ("inkloop.errors", "inkloop.files", "inkloop.limits", "inkloop.units")
COMMAND_LINE = ("inkloop.cli", "inkloop.commands")
PLOTS = (
    *(f"inkloop.report.{name}" for name in ("plot", "pictures", "part_picture", "surface_picture", "solid_picture")),
    "inkloop.report.layer_curves",
    "inkloop_lab",
    "inkloop.exchange.job_picture",
    "inkloop_controller.planning.layer_plan",
)
DOORS = {
    "fmpy": ("inkloop.fmu",),
    "casadi": ("inkloop_controller.program",),
    **dict.fromkeys(("can", "cantools", "isotp", "udsoncan", "e2e"), ("inkloop_hardware",)),
    **dict.fromkeys(("tifffile", "sdfio", "SurfaceTopography"), ("inkloop.metrology",)),
    "PIL": ("inkloop.metrology.picture_file", "inkloop.exchange.layers"),
    "trimesh": ("inkloop.geometry.ply_file", "inkloop.exchange.layers"),
    "lib3mf": ("inkloop.geometry.three_mf",),
    "pyopencl": ("inkloop_controller.gpu",),
    "odxtools": tuple(f"inkloop_hardware.protocol.odx_{name}" for name in ("file", "services", "values")),
    "contourpy": ("inkloop.metrology.evaluation.outline",),
    **dict.fromkeys(("dask", "distributed"), ("inkloop_lab.sweep.sites",)),
    "optuna": ("inkloop_lab.sweep.plan",),
    "gymnasium": tuple(f"inkloop_lab.environment.{name}" for name in ("layer_env", "freed_scenario", "target_offset")),
    "skfem": ("inkloop_lab.reproduce.finite_elements",),
    **dict.fromkeys(("matplotlib", "mpl_toolkits"), PLOTS),
    "plotly": tuple(f"inkloop.report.page.{name}" for name in ("page", "charts", "curves")),
}
ROOT_NAMES_MAX = {"inkloop": 24, "inkloop_controller": 10, "inkloop_hardware": 10, "inkloop_lab": 9}
CORE_LEVELS = {"problem": 0, "model": 1, "observer": 2, "search": 2, "relaxation": 2, "planner": 3, "step": 4, "": 5}
"""Groups of controller/core; the last is inkloop_core."""

COMMON_FILES = ("red_zones", "storage", "values", "snapshot", "lifecycle", "fmi2_component", "fmi3_component")
"""Files of fmus/common, each of which uses only those before it."""


def offenders(importers: Iterable[str], forbidden: Iterable[str]) -> list[str]:
    """`module imports module` of all importers that import something below a forbidden name."""
    names = tuple(forbidden)
    return [
        f"{name} imports {found}"
        for name in importers
        for found in sorted(imported(name))
        if any(is_below(found, below) for below in names)
    ]


def outside(*doors: str) -> list[str]:
    return [name for name in modules() if not any(is_below(name, door) for door in doors)]


def test_each_library_comes_in_by_its_doors() -> None:
    assert not [found for library, doors in DOORS.items() for found in offenders(outside(*doors), [library])]
    assert not [door for doors in DOORS.values() for door in doors if door not in modules()]


def test_the_floor_imports_numpy_and_itself_only() -> None:
    floor = FLOOR & set(modules())
    allowed = {*sys.stdlib_module_names, "numpy"}
    assert floor == FLOOR
    assert not [
        f"{name} imports {found}"
        for name in sorted(floor)
        for found in imported(name)
        if found.partition(".")[0] not in allowed and found not in floor
    ]


def test_modules_of_the_build_import_the_standard_library_only() -> None:
    allowed = {*sys.stdlib_module_names}
    own = {name for name in modules() if is_below(name, BUILD_TIME)} | {*BUILD_TIME_FLOOR}
    assert not [
        f"{name} imports {found}"
        for name in sorted(own)
        for found in imported(name)
        if found.partition(".")[0] not in allowed and found not in own | {"inkloop"}
    ]
    root = ast.parse(modules()["inkloop"].read_text(encoding="utf-8")).body  # which loads the public API on use
    assert {node.module for node in root if isinstance(node, ast.ImportFrom)} <= allowed
    assert {alias.name for node in root if isinstance(node, ast.Import) for alias in node.names} <= allowed


def test_controller_and_hardware_import_the_floor_only_and_never_each_other() -> None:
    inside = [name for name in modules() if is_below(name, "inkloop_controller") or is_below(name, "inkloop_hardware")]
    assert not [found for found in offenders(inside, ["inkloop"]) if found.split()[-1] not in FLOOR]
    assert not offenders(outside("inkloop_controller"), ["inkloop_controller"])
    assert not offenders(outside("inkloop_hardware"), ["inkloop_hardware"])


def test_nothing_imports_the_lab() -> None:
    """Its commands, and what makes components of policies, come in by entry points."""
    assert not offenders(outside("inkloop_lab"), ["inkloop_lab"])


def test_lab_takes_public_names_only() -> None:
    """Of the floor, of the root of a package, or in the `__all__` of a module."""
    taken = {
        (node.module, alias.name)
        for name in modules()
        if is_below(name, "inkloop_lab")
        for node in ast.walk(parsed(modules()[name]))
        if isinstance(node, ast.ImportFrom) and node.module not in FLOOR
        for alias in node.names
        if is_below(str(node.module), "inkloop") and f"{node.module}.{alias.name}" not in modules()
    }
    assert taken
    assert not {pair for pair in taken if pair[1] not in {*public_names(str(pair[0])), "__version__"}}


def test_master_knows_no_layer() -> None:
    own = [name for name in modules() if is_below(name, "inkloop.master")]
    assert not offenders(own, ["inkloop.contract", "inkloop.course", "inkloop.results", "inkloop.fmu"])


def test_nothing_imports_the_command_line() -> None:
    found = offenders(outside(*COMMAND_LINE, "inkloop_lab.commands"), COMMAND_LINE)
    assert not found
    used = {each.split()[-1] for each in offenders(["inkloop_lab.commands"], COMMAND_LINE)}
    assert used == {"inkloop.commands", "inkloop.commands.options"}


def test_modules_take_only_the_version_from_the_root_of_their_package() -> None:
    """`inkloop/__init__.py` stands on top of all modules; `import_graph` relies on that."""
    taken = re.compile(rf"^\s*from ({'|'.join(PACKAGES)}) import (\w.*)$", re.MULTILINE)
    found = [
        (name, f"{root}.{entry}")
        for name, path in modules().items()
        for root, names in taken.findall(path.read_text(encoding="utf-8"))
        for entry in names.split(", ")
    ]
    assert not [pair for pair in found if pair[1] not in modules() and pair[1] != "inkloop.__version__"]


def test_no_circle_joins_modules() -> None:
    """Imports inside functions count: a circle that is closed late is still one."""
    assert circles(import_graph()) == set()


def test_no_circle_joins_rooms() -> None:
    """Folders and files at the root of a package; the command line may import every room."""
    assert circles(grouped(import_graph(), {name: room(name) for name in modules()})) == set()


def test_circles_are_found() -> None:
    """The circle of two, the one of three that hangs below it, and the one name that imports itself."""
    graph = {"a": {"b"}, "b": {"a", "c"}, "c": {"d"}, "d": {"e"}, "e": {"c"}, "f": {"a"}, "g": {"g"}}
    assert circles(graph) == {frozenset("ab"), frozenset("cde"), frozenset("g")}


def test_few_names_stand_at_the_root_of_a_package() -> None:
    for package, folder in PACKAGES.items():
        names = {path.name for path in folder.iterdir() if path.suffix == ".py" or (path / "__init__.py").exists()}
        assert len(names - {"__init__.py"}) <= ROOT_NAMES_MAX[package], sorted(names)


def test_no_circle_joins_c_files() -> None:
    """A source and its header are one; what is called is declared in a header that is included (below)."""
    graph = include_graph()
    assert graph["fmus/common/values"] >= {"fmus/common/storage"}
    assert graph["hardware/firmware/node/node"] >= {"hardware/firmware/node/steps"}
    assert circles(graph) == set()


def test_functions_are_declared_by_their_own_header_or_by_an_interface() -> None:
    """So the includes show every call; an interface is a header without a source, like kernel.h and parallel.h."""
    definition = re.compile(r"^(?!static|\s|#|//|/\*)[A-Za-z_][\w *]*?\b(\w+)\([^;{}]*\)\s*\{", re.MULTILINE)
    prototype = re.compile(r"^(?!static|\s|#|//|/\*|typedef)[A-Za-z_][\w *]*?\b(\w+)\([^;{}]*\);", re.MULTILINE)
    interfaces = "".join(
        path.read_text(encoding="utf-8")
        for path in c_files()
        if path.suffix == ".h" and not path.with_suffix(".c").exists()
    )
    undeclared = []
    for path in c_files():
        if path.suffix == ".h":
            continue
        text, header = path.read_text(encoding="utf-8"), path.with_suffix(".h")
        declared = interfaces + (header.read_text(encoding="utf-8") if header.exists() else "")
        names = [*definition.findall(text), *(f"{name};" for name in prototype.findall(text))]
        undeclared += [f"{c_unit(path)}: {name}" for name in names if not re.search(rf"\b{name}\(", declared)]
    image = "hardware/firmware/cortex_m"
    assert {found for found in undeclared if not re.search(r": fmi[23][A-Z]\w+$", found)} == {
        *("hardware/firmware/host/main: main", f"{image}/main: main"),
        *(f"{image}/startup: {name}" for name in ("reset", "reset;", "main;")),
    }  # the standard declares the functions of FMI, the linker looks for the others


def test_no_arrow_goes_upwards_between_the_groups_of_the_controller_core() -> None:
    core = ROOT / "controller" / "core"
    units = {
        c_unit(path): (path.parent.name if path.parent != core else "")
        for path in c_files()
        if path.is_relative_to(core)
    }
    assert set(units.values()) == set(CORE_LEVELS)
    arrows = {(units[unit], units[other]) for unit in units for other in include_graph()[unit] if other in units}
    assert not {
        (group, other) for group, other in arrows if group != other and CORE_LEVELS[group] <= CORE_LEVELS[other]
    }


def test_common_files_of_the_fmus_use_only_files_before_them() -> None:
    order = [f"fmus/common/{name}" for name in COMMON_FILES]
    arrows = {(unit, other) for unit in order for other in include_graph()[unit] if other in order}
    assert arrows
    assert not {(unit, other) for unit, other in arrows if order.index(other) > order.index(unit)}


def in_sources(folders: Iterable[Path], pattern: str) -> list[str]:
    """Every match of the pattern in the C files of the folders, with its file."""
    paths = [path for path in c_files() if path.parent in set(folders)]
    assert paths
    return [
        f"{path.name}: {match[0]}" for path in paths for match in re.finditer(pattern, path.read_text(encoding="utf-8"))
    ]


def test_kernels_know_no_fmi_type() -> None:
    folders = {path.parent for path in c_files()} - {ROOT / "fmus" / "common"}
    assert not in_sources(folders, r"#\s*include\s*[<\"]fmi\d.*|\bfmi[23][A-Z]\w*")


def test_firmware_needs_no_operating_system() -> None:
    """node/ and can/: a microcontroller without one runs the same files, and nothing is allocated."""
    folders = [ROOT / "hardware" / "firmware" / name for name in ("node", "can")]
    headers = in_sources(folders, r"#\s*include\s*<.*?>")
    allowed = {"stdbool.h", "stddef.h", "stdint.h", "string.h"}
    assert {re.findall("<(.*)>", found)[0] for found in headers} <= allowed
    assert not in_sources(folders, r"\b(malloc|calloc|realloc|free)\s*\(")

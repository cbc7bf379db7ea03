"""The modules and C files of the project: what each imports or includes, and the circles in such a graph."""

from __future__ import annotations

import ast
import gc
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from support.places import ROOT

PACKAGES = {
    "inkloop": ROOT / "cosim" / "inkloop",
    "inkloop_controller": ROOT / "controller" / "inkloop_controller",
    "inkloop_hardware": ROOT / "hardware" / "inkloop_hardware",
    "inkloop_lab": ROOT / "lab" / "inkloop_lab",
}
C_FOLDERS = (
    *(ROOT / "fmus", ROOT / "controller" / "core"),
    *(ROOT / "cosim" / "columns", ROOT / "hardware" / "firmware"),
)
Graph = Mapping[str, set[str]]


def is_below(module: str, package: str) -> bool:
    """True for the package itself, too."""
    return module == package or module.startswith(f"{package}.")


def module_name(path: Path, root: Path) -> str:
    """The dotted name of a file below the folder that is on the path of Python."""
    parts = path.relative_to(root).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def modules() -> dict[str, Path]:
    """Every module of the four packages, by name."""
    return {
        module_name(path, folder.parent): path for folder in PACKAGES.values() for path in sorted(folder.rglob("*.py"))
    }


@cache
def parsed(path: Path) -> ast.Module:
    """The syntax tree of a file, which several tests look through.

    Without the garbage collector, which would look through all trees again and again and take most of the time.
    """
    gc.disable()
    try:
        return ast.parse(path.read_text(encoding="utf-8"), str(path))
    finally:
        gc.enable()


@cache
def imported(name: str) -> frozenset[str]:
    """Every module that a module imports, at its top, inside a function or for the type checker alone.

    `from a.b import c` counts as `a.b.c` where that is a module of the project, else as `a.b`.
    """
    path, found = modules()[name], set[str]()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            full = [f"{node.module}.{alias.name}" for alias in node.names]
            found.update(entry if entry in modules() else str(node.module) for entry in full)
    return frozenset(found)


def public_names(module: str) -> list[str]:
    """`__all__` of a module; no names if it has none."""
    for node in parsed(modules()[module]).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__":
            return list(ast.literal_eval(node.value))
    return []


@cache
def import_graph() -> dict[str, set[str]]:
    """Module -> modules of the project that it imports; the public API of a package stands on top of its modules."""
    return {name: (set(imported(name)) & set(modules())) - {name, *PACKAGES} for name in modules()}


def room(module: str) -> str:
    """The folder or file at the root of its package that a module belongs to."""
    return ".".join(module.split(".")[:2])


def grouped(graph: Graph, group_of: Mapping[str, str]) -> dict[str, set[str]]:
    """The graph between groups."""
    found: dict[str, set[str]] = {group: set() for group in group_of.values()}
    for name, below in graph.items():
        found[group_of[name]] |= {group_of[other] for other in below} - {group_of[name]}
    return found


def circles(graph: Graph) -> set[frozenset[str]]:
    """The groups of names each of which reaches every other."""
    reached: dict[str, set[str]] = {}
    for start in graph:
        reached[start], left = set(), [start]
        while left:
            new = graph[left.pop()] - reached[start]
            reached[start] |= new
            left += new
    return {
        frozenset(end for end in reached[start] if start in reached[end]) for start in graph if start in reached[start]
    }


@cache
def c_files() -> tuple[Path, ...]:
    """Sources and headers of the FMUs, the controller, the columns and the firmware."""
    return tuple(path for folder in C_FOLDERS for path in sorted(folder.rglob("*.[ch]")))


def c_unit(path: Path) -> str:
    """A source and its header are one unit, named by its path in the project."""
    return path.relative_to(ROOT).with_suffix("").as_posix()


@cache
def include_graph() -> dict[str, set[str]]:
    """C unit -> units of the project that its source or header includes."""
    headers = {path.name: c_unit(path) for path in c_files() if path.suffix == ".h"}
    assert len(headers) == sum(path.suffix == ".h" for path in c_files()), "two headers of one name"
    graph: dict[str, set[str]] = {c_unit(path): set() for path in c_files()}
    for path in c_files():
        found = re.findall(r'^\s*#\s*include\s*"(.*?)"', path.read_text(encoding="utf-8"), re.MULTILINE)
        graph[c_unit(path)] |= {headers[name] for name in found if name in headers} - {c_unit(path)}
    return graph

"""Environment variables that the package reads are those that SECURITY.md documents, with those that libraries read."""

from __future__ import annotations

import ast
import inspect
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path

import can.util
from cantools import database

from support.page_commands import PAGES
from support.places import ROOT

PRODUCT = ("controller", "cosim", "hardware", "lab")
READS = {"os.environ.get", "os.environ.pop", "os.environ.setdefault", "os.getenv"}
OF_LIBRARIES = {"CAN_*": can.util, "CANTOOLS_CACHE_DIR": database, "TMPDIR": tempfile}
"""Documented variable -> module of a library that reads it."""
LIBRARY_PATH = "cosim/inkloop/files.py: variable"
"""The one name of a variable that is handed in, by `c_library`, whose callers count."""


def environment_names(tree: ast.Module) -> Iterator[ast.expr]:
    """The expressions that name a variable where a module reads it."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=function, args=[name, *_]) if ast.unparse(function) in READS:
                yield name
            case ast.Call(func=ast.Name("c_library"), args=[_, _, name, *_]):
                yield name
            case ast.Subscript(value=whole, slice=name, ctx=ast.Load()) if ast.unparse(whole) == "os.environ":
                yield name
            case ast.Compare(left=name, comparators=[whole]) if ast.unparse(whole) == "os.environ":
                yield name


def read_in(path: Path) -> set[str]:
    """The variables that a module reads; an expression without a value stands for itself."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    values: dict[str, ast.expr] = {}
    for node in ast.walk(tree):
        match node:
            case ast.Assign(targets=[ast.Name(name)], value=value) | ast.comprehension(ast.Name(name), value):
                values[name] = value
    found = set()
    for each in environment_names(tree):
        text = ast.unparse(each)
        while isinstance(each, ast.Name) and each.id in values:
            each = values[each.id]
        known = {node.value for node in ast.walk(each) if isinstance(node, ast.Constant)}
        found |= {str(name) for name in known} or {f"{path.relative_to(ROOT)}: {text}"}
    return found


def read() -> set[str]:
    """Of all modules, and of the C sources."""
    found = {name for folder in PRODUCT for path in (ROOT / folder).rglob("*.py") for name in read_in(path)}
    for folder in (*PRODUCT, "fmus"):
        for path in (ROOT / folder).rglob("*.[ch]"):
            found |= set(re.findall(r'getenv\(\s*"(\w+)"', path.read_text(encoding="utf-8")))
    return found


def test_variables_that_are_read_are_documented_and_no_others() -> None:
    (row,) = re.findall(r"^\| \*\*Environment variables\*\* \|.*$", (ROOT / "SECURITY.md").read_text(), re.MULTILINE)
    documented = set(re.findall(r"`([A-Z][A-Z_]+\*?)`", row))
    assert documented - OF_LIBRARIES.keys() == read() - {LIBRARY_PATH}
    for name, module in OF_LIBRARIES.items():
        assert name in documented
        assert name.rstrip("*") in inspect.getsource(module)


def test_variables_of_other_pages_are_read_too() -> None:
    """By the package, by the tests or by the build."""
    text = "".join(page.read_text() for page in PAGES)
    sources = (ROOT / "Makefile", *(ROOT / "tests").rglob("*.py"))
    others = {name for path in sources for name in re.findall(r"INKLOOP_\w+", path.read_text())}
    assert set(re.findall(r"(?<!-D)\bINKLOOP_\w+", text)) <= read() | others

"""Sections of api.md on the site, written from the public names and their docstrings."""

from __future__ import annotations

import dataclasses
import enum
import inspect
import re
from collections.abc import Callable, Iterator
from types import ModuleType
from typing import Any

from tools.figures.pages import DOCS, Texts, block

import inkloop
import inkloop_controller
import inkloop_lab
from support.source_tree import is_below, modules, public_names

WIDTH = 110  # of a signature on one line
GROUPS = {
    "Print and read": ("run", "load", "Scenario", "Result"),
    "Components of your own": ("Component", "Port", "Job", "Ink", "Status"),
    "FMUs": ("FmuComponent", "describe", "find_fmu", "export_fmu"),
    "Errors": (
        *("InkloopError", "ScenarioError", "FmuError", "ComponentError"),
        *("GeometryError", "HeightMapError", "ResultError"),
    ),
}


OPTIONS = "[Options](scenario.md#layermpc), in SI"
EXPLAINED = {
    **dict.fromkeys(("Criterion", "DropletChoices", "HeightEstimator", "LayerMpc", "Work"), OPTIONS),
    "LayerEnv": "[Observation, action, reward](../how-to/learn-a-policy.md)",
    "LayerPlan": "[Fields](layer-plan.md#the-record)",
}
"""Class -> the page that explains its arguments; here stand their names and the first paragraph of its docstring."""


def texts() -> Texts:
    """All public names. Raises ValueError for a public name that is in no group."""
    grouped = {name for names in GROUPS.values() for name in names}
    if left := set(inkloop.__all__) ^ grouped:
        raise ValueError(f"GROUPS and inkloop.__all__ differ in {', '.join(sorted(left))}")
    lines = [""]
    for group, names in GROUPS.items():
        lines += [f"## {group}", "", *_entries(inkloop, names)]
    lines += ["## The layer controller", "", "From `inkloop_controller`.", ""]
    lines += _entries(inkloop_controller, inkloop_controller.__all__)
    lines += ["## The lab", "", "From `inkloop_lab`.", "", *_entries(inkloop_lab, inkloop_lab.__all__)]
    text = "\n".join(lines).rstrip("\n") + "\n"
    return {DOCS / "reference" / "api.md": {"public names": f"\n{text}", "public modules": block(_public_modules())}}


def _public_modules() -> Iterator[str]:
    """A line for each module of inkloop below its root that has an `__all__`: its public names."""
    for name in modules():
        names = public_names(name) if is_below(name, "inkloop") and name != "inkloop" else []
        if names and not is_below(name, "inkloop.geometry"):
            yield f"- `{name}`: {', '.join(f'`{one}`' for one in names)}"


def _entries(package: ModuleType, names: tuple[str, ...] | list[str]) -> Iterator[str]:
    for name in names:
        entry = getattr(package, name)
        yield from (f"### {name}", "")
        if inspect.isclass(entry) and issubclass(entry, Exception):
            yield from (_first_paragraph(entry), "")
        elif inspect.isclass(entry) and issubclass(entry, enum.Enum):
            yield from (inspect.cleandoc(entry.__doc__ or ""), "")
            yield from (", ".join(f"{one.value} `{one.name}`" for one in entry) + ".", "")
        else:
            signature = _signature(name, entry, is_typed=name not in EXPLAINED)
            yield from ("```text", signature, "```", "", _explained(name, entry), "")
        if inspect.isclass(entry) and not issubclass(entry, Exception | enum.Enum):
            members = list(_members(name, entry))
            yield from (*members, "") if members else ()


def _explained(name: str, entry: object) -> str:
    if name in EXPLAINED:
        return f"{_first_paragraph(entry)} {EXPLAINED[name]}."
    return inspect.cleandoc(entry.__doc__ or "")


def _members(name: str, entry: type) -> Iterator[str]:
    """A line for each public method and property that the class defines itself, without types of arguments.

    Those of the protocol `Component` are explained there.
    """
    told = vars(inkloop.Component) if entry is not inkloop.Component and hasattr(entry, "do_step") else ()
    for member, value in vars(entry).items():
        if member.startswith("_") or member in told:
            continue
        function: Any = value.fget if isinstance(value, property) else getattr(value, "__func__", value)
        if not inspect.isfunction(function):
            continue
        shown = f"{name}.{member}" if isinstance(value, staticmethod | classmethod) else member
        signature = shown if isinstance(value, property) else _signature(shown, function, is_bound=True, is_typed=False)
        yield f"- `{' '.join(signature.split())}`: {_first_paragraph(function)}"


def _signature(name: str, entry: Callable[..., Any], *, is_bound: bool = False, is_typed: bool = True) -> str:
    """A call with defaults, on several lines where it is long and not of a member."""
    if getattr(entry, "_is_protocol", False):
        return f"class {name}(Protocol)"
    signature = inspect.signature(entry)
    parameters = list(signature.parameters.values())
    if any(parameter.name.startswith("_") for parameter in parameters):  # made by its class methods only
        return f"class {name}"
    if is_bound and parameters and parameters[0].name in ("self", "cls"):
        del parameters[0]
    shown, keyword_only = [], False
    for parameter in parameters:
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword_only:
            shown.append("*")
        keyword_only |= parameter.kind is parameter.KEYWORD_ONLY
        shown.append(_parameter(parameter, entry, is_typed=is_typed))
    returned = signature.return_annotation
    arrow = "" if inspect.isclass(entry) or returned is signature.empty else f" -> {_annotation(returned)}"
    line = f"{name}({', '.join(shown)}){arrow}"
    return (
        line
        if len(line) <= WIDTH or is_bound
        else f"{name}(\n" + "".join(f"    {one},\n" for one in shown) + f"){arrow}"
    )


def _parameter(parameter: inspect.Parameter, entry: Callable[..., Any], *, is_typed: bool) -> str:
    text = "**" + parameter.name if parameter.kind is parameter.VAR_KEYWORD else parameter.name
    is_typed = is_typed and parameter.annotation is not parameter.empty
    if is_typed:
        text += f": {_annotation(parameter.annotation)}"
    if parameter.default is parameter.empty:
        return text
    fields = {field.name: field for field in dataclasses.fields(entry)} if dataclasses.is_dataclass(entry) else {}
    field = fields.get(parameter.name)
    has_factory = field is not None and field.default_factory is not dataclasses.MISSING
    default = "..." if has_factory else repr(parameter.default)
    equals = " = " if is_typed else "="
    return f"{text}{equals}{default if len(default) <= WIDTH // 3 else '...'}"


def _annotation(annotation: object) -> str:
    """As written, without the mark of an option of scenarios."""
    text = annotation if isinstance(annotation, str) else getattr(annotation, "__name__", str(annotation))
    return re.sub(r"^Annotated\[(.+), (?:[A-Z_]+|(?:Option|declared)\(.*\))\]$", r"\1", text)


def _first_paragraph(entry: object) -> str:
    return " ".join(inspect.cleandoc(getattr(entry, "__doc__", None) or "").partition("\n\n")[0].split())

"""Write a scenario to start from: small and complete, with every optional table as a comment."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from inkloop.errors import ScenarioError
from inkloop.files import write_text

_TEMPLATES = files("inkloop.scenario") / "templates"
_SCENARIO = "scenario.toml"
"""The template of all scenarios; each other one holds the part of a shape."""


def shapes() -> list[str]:
    """The shapes that a new scenario can begin with."""
    names = (entry.name for entry in _TEMPLATES.iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml") and name != _SCENARIO)


def write(name: Path, shape: str) -> Path:
    """Write NAME.toml with a part of that shape; returns its path. Raises ScenarioError, overwrites nothing."""
    path = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    if path.exists():
        raise ScenarioError(str(path), ["is there already and is not overwritten; choose another name"])
    title = path.stem.replace("-", " ").replace("_", " ").replace('"', "'").capitalize()
    text = _template(_SCENARIO).replace("{title}", title).replace("{file}", path.name)
    text = text.replace("# {part}\n", _template(f"{shape}.toml"))
    try:
        write_text(path, text)
    except OSError as error:
        raise ScenarioError(str(path), [f"cannot be written: {error.strerror}"]) from error
    return path


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")

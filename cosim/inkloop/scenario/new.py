"""Write a scenario to start from: small and complete, with every optional table as a comment."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

import tomlkit

from inkloop.errors import ScenarioError
from inkloop.files import write_text
from inkloop.fmu import describe
from inkloop.scenario.part_file import ASSUMED_UNIT, PartFile
from inkloop.scenario.part_grid import FittedPart, fit
from inkloop.scenario.plant_file import Plant, plant_of, text_for_plant
from inkloop.tables.schema import RunTable

_TEMPLATES = files("inkloop.scenario") / "templates"
_SCENARIO = "scenario.toml"
"""The template of all scenarios; each other template is the part of a shape."""
_LAYERS_FACTOR = 2
"""Layers that a print may take, in full layers of the default ink."""


def shapes() -> list[str]:
    """The shapes that a new scenario can begin with."""
    names = (entry.name for entry in _TEMPLATES.iterdir())
    return sorted(name.removesuffix(".toml") for name in names if name.endswith(".toml") and name != _SCENARIO)


def write(name: Path, shape: str) -> Path:
    """Write NAME.toml with a part of that shape; returns its path. Raises ScenarioError, overwrites nothing."""
    path = _free(name)
    return _written(path, _titled(path).replace("# {part}\n", _template(f"{shape}.toml")))


def write_for_part(
    name: Path, file: PartFile, pitch_um: float | None = None, say: Callable[[str], None] = lambda sentence: None
) -> tuple[Path, FittedPart]:
    """Write NAME.toml that prints the part in a file; its path and the part. Raises ScenarioError.

    say: gets a sentence before work that takes long.
    """
    path = _free(name)
    part = fit(file, pitch_um, say)
    return _written(path, text_for_part(path, file, part)), part


def write_for_plant(name: Path, fmu: Path) -> tuple[Path, Plant]:
    """Write NAME.toml that prints a block with the plant in an FMU; its path and the plant.

    Raises ScenarioError, FmuError.
    """
    path = _free(name)
    plant = plant_of(describe(fmu))
    return _written(path, text_for_plant(path, _titled(path), plant)), plant


def text_for_part(path: Path, file: PartFile, part: FittedPart) -> str:
    """The scenario at `path` for a part on its grid."""
    grid, layers = part.grid, part.layers
    named = Path(os.path.relpath(file.path.absolute(), path.absolute().parent)).as_posix()
    table = tomlkit.document()
    keys = {"shape": file.shape, "file": named} | part.table.model_dump(exclude={"file"}, exclude_unset=True)
    table["part"] = keys
    lines = [tomlkit.dumps(table).rstrip(), f"# {part.size}, about {layers} layers of the default ink"]
    if file.assumes_unit:
        lines.append(f"# the file does not state its unit, {ASSUMED_UNIT} is assumed")
    unset = _template(f"file/{file.shape}.toml").splitlines()
    lines += [line for line in unset if line.split()[1] not in keys]
    if len(part.names) > 1:
        lines += ["", "# [part.inks]                    # ink of each object or material; without it one ink"]
        lines += [f'# {json.dumps(name)} = "A"' for name in part.names]
    lines += ["", _support(part), ""]
    text = _titled(path).replace("# {part}\n", "\n".join(lines))
    text = text.replace(
        "nx = 16\nny = 16\n# pitch_um = 263.256 ", f"nx = {grid.nx}\nny = {grid.ny}\npitch_um = {grid.pitch_um:g} "
    )
    enough = _LAYERS_FACTOR * layers
    if enough > RunTable.model_fields["layers_max"].default:
        text = text.replace("# [run]\n", f"[run]\nlayers_max = {enough}\n").replace("# layers_max = 1000\n", "")
    return text


def _support(part: FittedPart) -> str:
    if not part.hangs:
        return "# [support]\n# margin_cells = 2"
    if part.solid.region is None:
        return '[support]\nkind = "below-overhangs"   # or "around"'
    return '[support]\nkind = "none"   # prints what rests on the substrate; a support would need an ink of its own'


def _free(name: Path) -> Path:
    path = name if name.suffix == ".toml" else name.with_name(f"{name.name}.toml")
    if path.exists():
        raise ScenarioError(str(path), ["is there already and is not overwritten; choose another name"])
    return path


def _titled(path: Path) -> str:
    title = path.stem.replace("-", " ").replace("_", " ").replace('"', "'").capitalize()
    return _template(_SCENARIO).replace("{title}", title).replace("{file}", path.name)


def _written(path: Path, text: str) -> Path:
    try:
        write_text(path, text)
    except OSError as error:
        raise ScenarioError(str(path), [f"cannot be written: {error.strerror}"]) from error
    return path


def _template(name: str) -> str:
    return (_TEMPLATES / name).read_text(encoding="utf-8")

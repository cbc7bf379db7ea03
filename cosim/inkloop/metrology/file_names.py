"""Files whose names hold a number: "layer_{layer:04d}.csv"."""

from __future__ import annotations

import re
from pathlib import Path

from inkloop.limits import filled


def name_errors(key: str, template: str, field: str, example: str) -> list[str]:
    """Errors of the template of a file name, one sentence each; key: which the scenario gives it by."""
    expected = f"expected a name of its own for each layer, such as {example!r}"
    try:
        names = {filled(template, {field: number}) for number in (1, 2, 30)}
    except ValueError as error:
        return [f"{key} is {template!r} ({error}); {expected}"]
    if len(names) < 3 or any(Path(name).name != name for name in names):
        return [f"{key} is {template!r}; {expected}"]
    return []


def numbered_files(folder: Path, template: str, field: str) -> dict[int, Path]:
    """Number -> file, of all files in the folder that have the name of a number. Raises OSError."""
    number = re.compile(r"\d+")
    found: dict[int, Path] = {}
    for path in folder.iterdir():
        numbers = map(int, number.findall(path.name))
        found |= {each: path for each in numbers if filled(template, {field: each}) == path.name}
    return found

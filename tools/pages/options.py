"""Write rows of options in docs/reference/scenario.md: python tools/pages/options.py

A table below a line `<!-- options of CLASS -->` keeps its head. The rows of `LayerMpc` and its parts come from the
options that the class marks; a class that gives no meaning has that of the parameter in
fmus/layer_controller/variables.toml. The other rows come from the fields of a table.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from pydantic.fields import FieldInfo

from inkloop.components.fmu_parameters import options_of_controller_fmu
from inkloop.components.port_tables import PortTable
from inkloop.components.python_class import options_table
from inkloop.components.shadow.options import ShadowTable
from inkloop.fmu_writer import definition
from inkloop.metrology.map_folder import MapFolder
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.problem.options import Keyword, keywords

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "scenario.md"
DEFINITION = ROOT / "fmus" / "layer_controller" / "variables.toml"
MARKED = {each.__name__: each for each in (LayerMpc, Criterion, DropletChoices, Work, HeightEstimator)}
TABLES = {each.__name__: each for each in (options_table(MapFolder), PortTable, ShadowTable)}
CLASSES = {*MARKED, *TABLES}
TABLE = re.compile(r"(<!-- options of (\w+) -->\n\|.*\n\|[-|]+\n)((?:\|.*\n)*)")


def written(page: str) -> str:
    """The page with the rows as the classes have them."""
    model = definition.load(DEFINITION.read_text(encoding="utf-8"), DEFINITION)
    texts = {variable.name: variable.description for variable in model.variables}

    def rows(name: str) -> Iterator[str]:
        if name in TABLES:
            return (row_of_field(key, field) for key, field in TABLES[name].model_fields.items())
        return (row_of_keyword(each, texts) for each in keywords(MARKED[name]))

    return TABLE.sub(lambda found: found[1] + "".join(rows(found[2])), page)


def row_of_keyword(keyword: Keyword, texts: dict[str, str]) -> str:
    """The row of a marked option."""
    (name,) = options_of_controller_fmu({keyword.argument: None})
    text = keyword.option.meaning or with_code(texts[name])
    return row(keyword.key, default(keyword.default, keyword.option.absent), text)


def row_of_field(key: str, field: FieldInfo) -> str:
    """The row of a field of a table."""
    return row(key, "" if field.is_required() else default(field.default, "none"), with_code(field.description or ""))


def row(key: str, value: str, text: str) -> str:
    """Key, default, meaning."""
    return f"| `{key}` | {value}{' ' if value else ''}| {text[0].lower()}{text[1:]} |\n"


def with_code(text: str) -> str:
    """The text with the values in quotes as code."""
    return re.sub(r'("\w+")', r"`\1`", text)


def default(value: object, absent: str) -> str:
    """A default as a scenario has it."""
    if value is None:
        return absent
    if isinstance(value, float):
        return f"{value:g}"
    return f"{value}" if type(value) is int else f"`{json.dumps(value)}`"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

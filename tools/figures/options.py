"""Options in scenario.md and sweep-settings.md, one list for each class.

The rows of `LayerMpc` and its parts come from the options that the class marks, whose texts stand in
fmus/layer_controller/variables.toml. The other rows come from the fields of a table; of a height map those that a
map folder has too are left out.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from tools.figures.pages import DOCS, Texts

from inkloop.components.port_tables import PortTable
from inkloop.components.python_class import options_table
from inkloop.components.shadow_kind import ShadowTable
from inkloop.metrology.map_folder import MapFolder
from inkloop.tables.metrology import MetrologyTable
from inkloop.tables.part import CombineTable
from inkloop.tables.part_images import HeightMapTable, StackTable
from inkloop.tables.part_layers import LayersTable
from inkloop.tables.part_mesh import MeshTable
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.controllers import on_doubt_option
from inkloop_controller.problem.options import Keyword, keywords
from inkloop_lab.sweep.tables import KeepTable, OptimiseTable, SampleTable, SeedsTable

PAGE = DOCS / "reference" / "scenario.md"
STUDY_PAGE = DOCS / "how-to" / "sweep-settings.md"
STUDY_TABLES = (SampleTable, SeedsTable, OptimiseTable, KeepTable)
MARKED = {each.__name__: each for each in (LayerMpc, Criterion, DropletChoices, Work, HeightEstimator)}
PARTS = (MeshTable, StackTable, LayersTable, HeightMapTable, CombineTable)
TABLES = {each.__name__: each for each in (options_table(MapFolder), PortTable, ShadowTable, MetrologyTable, *PARTS)}
OF_ALL_PARTS = {"shape", "center_x_um", "center_y_um"}
"""Keys that the table on top of the page explains."""


def run() -> None:
    """Nothing: the rows come from the code."""


def texts() -> Texts:
    """The rows as the classes have them."""
    rows = {name: [row_of_keyword(each) for each in keywords(marked)] for name, marked in MARKED.items()}
    rows["HeightEstimator"] += map(row_of_keyword, keywords(on_doubt_option))
    rows |= {name: rows_of(fields) for name, fields in TABLES.items()}
    of_map = set(rows[MapFolder.__name__])
    rows[HeightMapTable.__name__] = [each for each in rows[HeightMapTable.__name__] if each not in of_map]
    study = {each.__name__: rows_of(each) for each in STUDY_TABLES}
    return {
        page: {f"options of {name}": lines(own[name]) for name in own}
        for page, own in ((PAGE, rows), (STUDY_PAGE, study))
    }


def lines(rows: Iterable[str]) -> str:
    """A line each."""
    return "\n" + "\n".join(rows) + "\n"


def rows_of(fields: type[BaseModel]) -> list[str]:
    """The rows of a table."""
    return [row_of_field(key, field) for key, field in fields.model_fields.items() if key not in OF_ALL_PARTS]


def row_of_keyword(keyword: Keyword) -> str:
    """The row of a marked option."""
    return row(keyword.key, default(keyword.default, keyword.option.absent), with_code(keyword.option.meaning))


def row_of_field(key: str, field: FieldInfo) -> str:
    """The row of a field of a table."""
    return row(key, "" if field.is_required() else default(field.default, "none"), with_code(field.description or ""))


def row(key: str, value: str, text: str) -> str:
    """Key, default and meaning."""
    return f"- `{key}`{f' ({value})' if value else ''}: {text[0].lower()}{text[1:]}"


def with_code(text: str) -> str:
    """The text with the values in quotes as code."""
    return re.sub(r'("[\w.{}:-]+")', r"`\1`", text)


def default(value: object, absent: str) -> str:
    """A default as a scenario has it."""
    if value is None:
        return absent
    if isinstance(value, float):
        return f"{value:g}"
    return f"{value}" if type(value) is int else f"`{json.dumps(value)}`"

"""Write the rows of options of LayerMpc in docs/reference/scenario.md: python tools/pages/options.py

A table below a line `<!-- options of CLASS -->` keeps its head; its rows come from the options that the class marks. A
class that gives no meaning has that of the parameter in fmus/layer_controller/variables.toml.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

from inkloop.components.fmu_parameters import options_of_controller_fmu
from inkloop.fmu_writer import definition
from inkloop_controller import Criterion, DropletChoices, HeightEstimator, LayerMpc, Work
from inkloop_controller.problem.options import Keyword, keywords

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "reference" / "scenario.md"
DEFINITION = ROOT / "fmus" / "layer_controller" / "variables.toml"
CLASSES = {each.__name__: each for each in (LayerMpc, Criterion, DropletChoices, Work, HeightEstimator)}
TABLE = re.compile(r"(<!-- options of (\w+) -->\n\|.*\n\|[-|]+\n)((?:\|.*\n)*)")


def written(page: str) -> str:
    """The page with the rows as the classes have them."""
    model = definition.load(DEFINITION.read_text(encoding="utf-8"), DEFINITION)
    texts = {variable.name: variable.description for variable in model.variables}
    return TABLE.sub(lambda found: found[1] + "".join(row(each, texts) for each in keywords(CLASSES[found[2]])), page)


def row(keyword: Keyword, texts: dict[str, str]) -> str:
    """A row: key, default, meaning."""
    (name,) = options_of_controller_fmu({keyword.argument: None})
    text = keyword.option.meaning or re.sub(r'("\w+")', r"`\1`", texts[name])
    return f"| `{keyword.key}` | {default(keyword)} | {text[0].lower()}{text[1:]} |\n"


def default(keyword: Keyword) -> str:
    """The default as a scenario has it."""
    value = keyword.default
    if value is None:
        return keyword.option.absent
    if isinstance(value, float):
        return f"{value:g}"
    return f"{value}" if type(value) is int else f"`{json.dumps(value)}`"


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")

"""Text between marks of a page, and the records that it is written from.

A page holds `<!-- name -->`, a text, and `<!-- end -->`: a whole table, or one figure within a sentence. A writer gives
the texts of its marks; the rest of the page is written by hand.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, TypeAlias, cast

from inkloop.files import write_text

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MARKED = re.compile(r"(<!-- (?!end -->)(.+?) -->)(.*?)(<!-- end -->)", re.DOTALL)

Texts: TypeAlias = Mapping[Path, Mapping[str, str]]
"""Page -> mark -> the text that belongs there."""


class Writer(Protocol):
    """A module that writes texts of pages."""

    def run(self, *parts: str) -> None:
        """Run what the texts report, or these parts of it; write the records, draw the pictures."""

    def texts(self) -> Texts:
        """The texts, from the records and from the code."""


def marks(page: str) -> list[str]:
    """Names of the marks of a page in their order."""
    return [found[2] for found in MARKED.finditer(page)]


def filled(page: str, texts: Mapping[str, str]) -> str:
    """The page with these texts; other marks keep theirs. Raises KeyError for a mark that the page lacks."""
    if missing := sorted(set(texts) - set(marks(page))):
        raise KeyError(f"the page has no mark {', '.join(missing)}")
    return MARKED.sub(lambda found: found[1] + texts.get(found[2], found[3]) + found[4], page)


def fill(texts: Texts) -> None:
    """Write the texts into their pages."""
    for page, own in texts.items():
        write_text(page, filled(page.read_text(encoding="utf-8"), own))


def block(lines: Iterable[str]) -> str:
    """Lines between two marks that stand alone."""
    return "\n" + "".join(f"{line}\n" for line in lines)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table between two marks; columns of numbers are aligned to the right."""
    cells = list(rows)
    is_number = [all(re.fullmatch(r"[-+\d].*|-", row[column]) for row in cells) for column in range(len(heads))]
    rule = "".join("|---:" if right else "|---" for right in is_number)
    head, *lines = ("".join(f"| {cell} " if cell else "| " for cell in line) for line in (heads, *cells))
    return block(f"{line}|" for line in (head, rule, *lines))


def write_json(path: Path, record: object) -> None:
    """Keep a record."""
    write_text(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")


def read_json(path: Path) -> Any:
    """The record."""
    return json.loads(path.read_text(encoding="utf-8"))


WRITERS = (
    "options",
    "can_protocol",
    "house",
    "diagrams",
    "gallery",
    "closed_loop",
    "lying_scans",
    "the_papers",
)
"""Modules of this folder."""
ALONE = ("performance",)
"""Run only when named: `make benchmarks` wants the machine for itself."""


SITE = ("api", "command_line")
"""Written into the pages by `make site` alone: `help()` and `--help` say the same."""


def writer(name: str) -> Writer:
    """The module of a writer."""
    return cast(Writer, import_module(f"tools.figures.{name}"))

"""The page of a study: what was asked, what every point came to, and the pictures next to it, in one file of HTML."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

from inkloop.report.terminal import NumberTable
from inkloop_lab.sweep.study import Study

PAGE_FILE = "study.html"
SHOWN = (".png", ".svg")
"""Pictures that browsers show; others are linked."""
_STYLE = """
:root { color-scheme: light dark }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2em auto; max-width: 70em; padding: 0 1em }
table { border-collapse: collapse; display: block; overflow-x: auto }
caption { text-align: left; padding: 0.3em 0; opacity: 0.7 }
th, td { padding: 0.15em 0.8em; text-align: right; border-bottom: 1px solid #8884 }
th:first-child, td:first-child { text-align: left }
img { max-width: 100%; background: white; margin: 0.5em 0 }
pre { overflow-x: auto }
"""


def page(
    study: Study, size: str, tables: Sequence[NumberTable], errors: Sequence[tuple[str, int]], pictures: Sequence[Path]
) -> str:
    """HTML that loads nothing but the pictures, which lie in its folder.

    size: a sentence on what was printed; errors: texts with how many prints failed of each.
    """
    parts = [f"<h1>{escape(study.title)}</h1>", f"<p>{escape(size)}</p>"]
    parts += [_picture(path.name) for path in pictures]
    parts += [_table(table) for table in tables]
    if errors:
        rows = "".join(f"<li>{count}: {escape(text)}</li>" for text, count in errors)
        parts.append(f"<h2>Prints that failed</h2><ul>{rows}</ul>")
    sources = {"The study": study.text, "The scenario": study.scenario.text}
    parts += _sources(sources)
    head = f'<meta charset="utf-8"><title>{escape(study.title)}</title><style>{_STYLE}</style>'
    return "\n".join(["<!doctype html>", '<html lang="en">', head, *parts, "</html>", ""])


def _picture(name: str) -> str:
    shown = Path(name).suffix in SHOWN
    inside = f'<img src="{escape(name)}" alt="{escape(Path(name).stem)}">' if shown else escape(name)
    return f'<p><a href="{escape(name)}">{inside}</a></p>'


def _table(table: NumberTable) -> str:
    """A table of the terminal with all of its rows."""
    columns = [[str(cell) for cell in column.cells] for column in table.columns]
    heads = "".join(f"<th>{escape(' '.join(str(column.header).split()))}</th>" for column in table.columns)
    rows = "\n".join(
        f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in zip(*columns, strict=True)
    )
    caption = f"<caption>{escape(table.note)}</caption>" if table.note else ""
    return f"<table>{caption}<thead><tr>{heads}</tr></thead><tbody>\n{rows}\n</tbody></table>"


def _sources(texts: Mapping[str, str]) -> Iterator[str]:
    for name, text in texts.items():
        yield f"<details><summary>{name}</summary><pre>{escape(text)}</pre></details>"

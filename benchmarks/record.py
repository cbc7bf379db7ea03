"""Benchmarks as a record: each table as texts, the processor time that it took, the machine, and versions."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Sequence
from time import process_time
from typing import Any

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from benchmarks import machine


def measured(names: Sequence[str], console: Console) -> dict[str, Any]:
    """Run benchmarks, print their tables, and return them as a record."""
    tables = []
    for name in names:
        begin = process_time()
        found = importlib.import_module(f"benchmarks.{name}").measure()
        taken = process_time() - begin
        console.print(found)
        tables += [{"benchmark": name, "processor_s": round(taken, 1)} | table for table in tables_of(found)]
    return {"machine": machine.described(), "versions": machine.versions(), "tables": tables}


def tables_of(found: Any) -> Iterator[dict[str, Any]]:
    """Title, headings, rows and notes of each table in what a benchmark returns."""
    parts = list(found.renderables) if isinstance(found, Group) else [found]
    notes = [part.plain for part in parts if isinstance(part, Text)]
    inner = [table for part in parts if isinstance(part, Group) for table in tables_of(part)]
    tables = [part for part in parts if isinstance(part, Table)]
    for number, table in enumerate(tables):
        yield {
            "title": _plain(table.title),
            "headings": [_plain(column.header) for column in table.columns],
            "rows": [
                list(row)
                for row in zip(*([_plain(cell) for cell in column.cells] for column in table.columns), strict=True)
            ],
            "notes": notes if number == len(tables) - 1 else [],
        }
    yield from inner


def _plain(text: Any) -> str:
    return " ".join(str(text or "").split())

"""Tables of pages that tests make again."""

from __future__ import annotations

from collections.abc import Sequence

from support.places import ROOT


def rows_of(page: str, heads: Sequence[str]) -> list[tuple[str, ...]]:
    """The rows below these heads on a page of `docs`. Raises ValueError where it has no such table."""
    lines = [_cells(line) for line in (ROOT / "docs" / page).read_text(encoding="utf-8").splitlines()]
    first = lines.index(tuple(heads)) + 2
    return lines[first : lines.index((), first)]


def _cells(line: str) -> tuple[str, ...]:
    """The cells of a line of a table, none of another line."""
    return tuple(cell.strip() for cell in line[1:-1].split("|")) if line.startswith("|") else ()

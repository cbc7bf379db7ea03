"""Tables of bench-faults.md: what nodes record of failures and refuse, lossy buses, times to the dark lamp, kills."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from tools.figures.pages import DOCS, Texts, read_json, table, write_json

PAGE = DOCS / "reference" / "bench-faults.md"
RECORD = PAGE.with_suffix(".json")


def failures() -> list[Sequence[str]]:
    """Failures of a print between processes."""
    from support.benches.failures import HEADS, rows

    return [HEADS, *rows()]


def refusals() -> list[Sequence[str]]:
    """Faults that could injure a person, on the firmware alone."""
    from support.benches.refusals import HEADS, rows

    return [HEADS, *rows()]


def losses() -> list[Sequence[str]]:
    """Prints over a bus that loses frames."""
    from benchmarks.bench_faults import LOSS_HEADS
    from benchmarks.bench_faults import losses as rows

    return [LOSS_HEADS, *rows()]


def reactions() -> list[Sequence[str]]:
    """Times to the dark lamp."""
    from benchmarks.bench_faults import REACTION_HEADS
    from benchmarks.bench_faults import reactions as rows

    return [REACTION_HEADS, *rows()]


def kills() -> list[Sequence[str]]:
    """Prints that are killed again and again."""
    from benchmarks.kills import HEADS, rows

    return [HEADS, *rows()]


TABLES: dict[str, Callable[[], Iterable[Sequence[str]]]] = {
    "failures": failures,
    "refusals": refusals,
    "losses": losses,
    "reactions": reactions,
    "kills": kills,
}
"""Mark of the page -> its rows."""


def run(*parts: str) -> None:
    """Make the tables, or those of these marks, again."""
    record = read_json(RECORD) if RECORD.exists() else {}
    made = {name: [list(row) for row in TABLES[name]()] for name in parts or TABLES}
    write_json(RECORD, {name: rows for name in TABLES if (rows := (record | made).get(name))})


def texts() -> Texts:
    """The tables."""
    return {PAGE: {name: table(heads, rows) for name, (heads, *rows) in read_json(RECORD).items()}}

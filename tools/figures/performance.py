"""Speed and size, measured: docs/reference/performance.md from the record of `make benchmarks`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks import RECORDED, use_one_thread
from tools.figures.pages import DOCS, Texts, block, read_json, table, write_json

PAGE = DOCS / "reference" / "performance.md"
RECORD = PAGE.with_suffix(".json")
PRINTERS = "whole_layer"
RECORD_ONLY = frozenset({"controller_time", "estimator", "time_limit"})
"""Benchmarks whose tables are in the record only."""
LEFT_OUT = frozenset({
    "Numba / inkloop", "Numba, branch-free / inkloop", "NumPy / inkloop", "FMPy / inkloop", "gain",
    "of it columns", "intervals", "open columns", "membership of a cell",
})  # fmt: skip
"""Columns of the record that follow from others or that readers do not compare; the page leaves them out."""


def run(*parts: str) -> None:
    """Measure everything, or these benchmarks; keep the other tables of the record. The row of a GPU is shown only."""
    use_one_thread()
    from benchmarks import on_device
    from benchmarks.record import measured
    from rich.console import Console

    console = Console(width=140)
    found = measured(parts or RECORDED, console)
    if not parts:
        console.print(on_device.measure())
    if parts and RECORD.exists():
        kept = [each for each in read_json(RECORD)["tables"] if each["benchmark"] not in parts]
        found["tables"] = sorted([*kept, *found["tables"]], key=lambda each: _place(each["benchmark"]))
    write_json(RECORD, found)


def _place(name: str) -> int:
    return RECORDED.index(name) if name in RECORDED else len(RECORDED)


def texts() -> Texts:
    """The machine, the versions, what a layer takes on printers of several sizes, and the other tables."""
    record = read_json(RECORD)
    others = [each for each in record["tables"] if each["benchmark"] not in {PRINTERS, *RECORD_ONLY}]
    own = [each for each in record["tables"] if each["benchmark"] == PRINTERS]
    return {
        PAGE: {
            "machine": _list(record["machine"]),
            "versions": _list(record["versions"]),
            "printers": _tables(own),
            "tables": _tables(others),
        }
    }


def _list(values: Mapping[str, str]) -> str:
    return "; ".join(f"{name} {value}" for name, value in values.items())


def _tables(tables: Sequence[Mapping[str, Any]]) -> str:
    lines: list[str] = []
    for each in tables:
        command = f"`python -m benchmarks {each['benchmark']}`"
        lines += ["", f"**{each['title'][:1].upper()}{each['title'][1:]}.** {command}", ""]
        lines += _shown(each["headings"], each["rows"]).strip("\n").splitlines()
        lines += [line for note in each["notes"] for line in ("", f"{note[:1].upper()}{note[1:]}.")]
    return block([*lines[1:], ""])


def _shown(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    kept = [index for index, heading in enumerate(headings) if heading not in LEFT_OUT]
    return table([headings[index] for index in kept], [[row[index] for index in kept] for row in rows])

"""`inkloop bench doctor`: check the bench of a scenario and give advice on every finding."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from rich.table import Table
from rich.text import Text

from inkloop.bench.commands import job_of_printer, mapping_of
from inkloop.components import devices
from inkloop.components.catalog import MAPPED
from inkloop.components.kind import Bench
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop.tables.schema import BenchTable

WELL, ERRORS = 0, 1
"""Exit codes."""
STYLES = {"ok": "green", "warning": "yellow", "error": "bold red", "skipped": "dim"}


def examine(scenario: Scenario | None, options: argparse.Namespace, console: Terminal) -> int:
    """Check the bench and print the findings; returns the exit code."""
    doctor = importlib.import_module("inkloop_hardware.doctor.doctor")
    table = scenario.tables.bench.found_from(Path(scenario.source).parent) if scenario else BenchTable()
    bench = Bench(table)
    expected = doctor.Expected(job_of_printer(scenario), bench.table.cure_ms) if scenario else None
    self_test = options.self_test and (options.yes or _agreed(doctor.WHAT))
    waiting = console.status("looking at the bench ...") if console.is_terminal else nullcontext()
    with waiting:
        mapping = _mapping(scenario)
        looked = doctor.examine(bench.rig.settings, expected, self_test=self_test, mapping=mapping)
        found = [*_of_scenario(scenario), *looked]
    errors = sum(finding.grade == "error" for finding in found)
    code = ERRORS if errors else WELL
    console.print(_table(found))
    console.sentence(_verdict(errors))
    console.failures(f"{each.check}: {each.found}; {each.advice}" for each in found if each.grade == "error")
    console.result(exit_code=code, findings=[finding.to_json() for finding in found])
    return code


def _of_scenario(scenario: Scenario | None) -> Iterator[Any]:
    """Findings about the valid [bench] table of a scenario."""
    if scenario is None:
        return
    finding = importlib.import_module("inkloop_hardware.doctor.findings").Finding
    kinds = {table.kind for table in scenario.tables.components.values()}
    bench = scenario.tables.bench
    if kinds.isdisjoint({*devices.KINDS, MAPPED}):
        yield finding.warning(
            "scenario", f"no component of {scenario.source} is a device", 'set kind = "hardware.printer"'
        )
    elif bench.interface is None or bench.channel is None:
        missing = " and ".join(f"bench.{key}" for key in ("interface", "channel") if getattr(bench, key) is None)
        yield finding.warning(
            "scenario", f"{scenario.source}: {missing} not set", "python-can's own configuration counts"
        )
    else:
        yield finding.ok("scenario", f"{scenario.source}: {bench.interface} on {bench.channel}")


def _mapping(scenario: Scenario | None) -> Any:
    """The mapping of a scenario whose only devices are those of one, else None."""
    tables = scenario.tables.components if scenario else {}
    kinds = {table.kind: name for name, table in tables.items()}
    if scenario is None or MAPPED not in kinds or not kinds.keys().isdisjoint(devices.KINDS):
        return None
    return mapping_of(scenario, kinds[MAPPED])


def _agreed(what: str) -> bool:
    """Whether the user confirms; no without a terminal."""
    print(f"Self test: {what}. Ultraviolet light harms eyes and skin.", file=sys.stderr)
    print("Is the enclosure closed, with no hand in it? [y/N] ", end="", file=sys.stderr, flush=True)
    return sys.stdin.readline().strip().lower() in ("y", "yes")


def _table(found: Sequence[Any]) -> Table:
    table = Table(show_edge=False, pad_edge=False)
    for heading in ("check", "", "found", "what to do"):
        table.add_column(heading, overflow="fold")
    for number, finding in enumerate(found):
        again = number > 0 and found[number - 1].check == finding.check
        style = STYLES[str(finding.grade)]
        columns = (str(finding.grade), finding.found, finding.advice)
        table.add_row("" if again else finding.check, *(Text(words, style) for words in columns))
    return table


def _verdict(errors: int) -> str:
    if errors == 0:
        return "ready to print"
    return f"{errors} {'error' if errors == 1 else 'errors'}: correct {'it' if errors == 1 else 'them'} before a print"

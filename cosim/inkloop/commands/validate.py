"""`inkloop validate`."""

from __future__ import annotations

import argparse
from typing import Any

from inkloop.commands.options import add_scenario, scenario_of


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser("validate", help="check a scenario and list all its errors")
    add_scenario(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print warnings and a summary of a valid scenario; returns the exit code."""
    from inkloop.printing.run import RUNS

    with scenario_of(options) as scenario:
        scenario.footprint.check_disk(RUNS)
        for remark in scenario.solid.remarks:
            print(f"{options.scenario}: warning: part: {remark}")
        grid = scenario.tables.grid
        printed = int(scenario.job().mask.sum())
        print(
            f"{options.scenario}: no errors; {grid.nx} x {grid.ny} cells, {printed} printed, "
            f"components {', '.join(scenario.tables.components)}; {scenario.footprint}"
        )
    return 0

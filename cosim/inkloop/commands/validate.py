"""`inkloop validate`."""

from __future__ import annotations

import argparse
from typing import Any

from inkloop.commands.options import add_scenario, scenario_of, screen
from inkloop.files import RUNS


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser("validate", help="check a scenario and list all its errors")
    add_scenario(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Print warnings and a summary of a valid scenario; returns the exit code."""
    with scenario_of(options) as scenario:
        scenario.footprint.check_disk(RUNS)
        grid = scenario.tables.grid
        printed = int(scenario.job().mask.sum())
        components = list(scenario.tables.components)
        terminal, warnings = screen(options), list(scenario.warnings)
        for warning in warnings:
            terminal.sentence(f"{options.scenario}: warning: {warning}")
        terminal.sentence(
            f"{options.scenario}: no errors; {grid.nx} x {grid.ny} cells, {printed} printed, "
            f"components {', '.join(components)}; {scenario.footprint}"
        )
        footprint = scenario.footprint
        terminal.result(
            scenario=options.scenario,
            errors=[],
            warnings=warnings,
            cells=[grid.nx, grid.ny],
            printed_cells=printed,
            components=components,
            layers=footprint.layers,
            memory_bytes=footprint.memory,
            disk_bytes=footprint.disk,
            processor_s=footprint.seconds,
        )
    return 0

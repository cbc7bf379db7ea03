"""`inkloop run`, `resume` and `validate`: a scenario, printed or checked."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands import Part
from inkloop.commands.options import (
    add_isolate,
    add_pictures,
    add_scenario,
    formats_of,
    is_isolated,
    scenario_of,
    screen,
)
from inkloop.files import RUNS


def _add_run(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "run", help="print the part of a scenario; writes tables, pictures and a result file"
    )
    add_scenario(parser)
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="new run folder (default: runs/NAME, or runs/NAME-2, ... if that exists)",
    )
    parser.add_argument(
        "--on-part",
        action="append_const",
        const="bench.on_part=true",
        dest="overrides",
        help="on devices: the bed may carry a part, as with --set bench.on_part=true",
    )
    parser.add_argument("--no-compare", action="store_true", help="skip the comparison runs of the scenario")
    add_pictures(parser)
    add_isolate(parser)
    return parser


def _run(options: argparse.Namespace) -> int:
    """Print, in a subprocess where asked; the exit code."""
    from inkloop.printing import run as printing

    with scenario_of(options) as scenario:
        if not is_isolated(options, scenario):
            return printing.run(
                scenario,
                options.out,
                screen(options),
                compare=not options.no_compare,
                pictures=formats_of(options),
            )
        from inkloop.printing.isolation import run_isolated

        folder = printing.checked_run_folder(scenario, options.out, options.scenario.stem)
        return run_isolated([*options.words, "--no-isolate", "--out", str(folder)], folder, scenario.foreign_fmus)


def _add_resume(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser("resume", help="resume an interrupted run")
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder of the interrupted run")
    parser.add_argument(
        "--layer-is",
        choices=("printed", "blank", "unknown"),
        help="of a rig with its own frames: what a person has seen of the layer that was begun and not finished",
    )
    add_pictures(parser)
    add_isolate(parser)
    return parser


def _resume(options: argparse.Namespace) -> int:
    """Print the remaining layers, in a subprocess where asked; the exit code."""
    from inkloop.printing import run as printing

    with printing.scenario_of_run(options.run) as scenario:
        if not is_isolated(options, scenario):
            seen = options.layer_is
            return printing.resume(scenario, options.run, screen(options), pictures=formats_of(options), layer_is=seen)
        from inkloop.printing.isolation import run_isolated

        return run_isolated([*options.words, "--no-isolate"], options.run, scenario.foreign_fmus)


def _add_validate(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser("validate", help="check a scenario and list all its errors")
    add_scenario(parser)
    return parser


def _validate(options: argparse.Namespace) -> int:
    """Print warnings and a summary of a valid scenario; returns the exit code."""
    from inkloop.scenario.support import Supported

    with scenario_of(options) as scenario:
        scenario.footprint.check_disk(RUNS)
        grid = scenario.tables.grid
        printed = int(scenario.job().mask.sum())
        components = list(scenario.tables.components)
        terminal, warnings, support = screen(options), list(scenario.warnings), Supported.of(scenario)
        for warning in warnings:
            terminal.sentence(f"{options.scenario}: warning: {warning}")
        terminal.sentence(
            f"{options.scenario}: no errors; {grid.nx} x {grid.ny} cells, {printed} printed, "
            f"components {', '.join(components)}; {f'support: {support}; ' if support else ''}{scenario.footprint}"
        )
        footprint = scenario.footprint
        terminal.result(
            scenario=options.scenario,
            errors=[],
            warnings=warnings,
            cells=[grid.nx, grid.ny],
            printed_cells=printed,
            support=support.data() if support else None,
            components=components,
            layers=footprint.layers,
            memory_bytes=footprint.memory,
            disk_bytes=footprint.disk,
            processor_s=footprint.seconds,
        )
    return 0


PARTS = (Part(_add_run, _run), Part(_add_resume, _resume), Part(_add_validate, _validate))

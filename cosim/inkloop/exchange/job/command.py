"""`inkloop export-job`: a scenario as one block with scalar inputs and outputs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from rich.console import Console

from inkloop.exchange.job import archive
from inkloop.exchange.job.baking import bake
from inkloop.scenario.file import Scenario


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "export-job", help="write a scenario as one FMU with scalar inputs and outputs, for tools without arrays"
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="a .toml file")
    parser.add_argument("--fmi", choices=tuple(archive.FORMS), default="2", help="FMI version (default 2)")
    parser.add_argument(
        "--windows", action="store_true", help="add a binary for 64-bit Windows; needs mingw-w64 on this machine"
    )
    parser.add_argument("-o", "--out", type=Path, metavar="FILE", help="file to write (default: NAME.fmu)")
    return parser


def export(scenario: Scenario, options: argparse.Namespace, console: Console) -> int:
    """Write, and say what it is; the exit code. Raises ScenarioError, FmuError."""
    baked = bake(scenario)
    out = options.out or Path(f"{Path(scenario.source).stem}.fmu")
    archive.write(baked, options.fmi, out, windows=options.windows)
    models = ", ".join(model for model, _ in baked.parts.values())
    console.print(f"wrote {out}: {models} in one block, a layer each {baked.own['layer_period']:g} s", highlight=False)
    if scenario.tables.run.time_max_s is not None:
        console.print("  time_max_s is not in it: the importer decides when it stops", highlight=False)
    return 0

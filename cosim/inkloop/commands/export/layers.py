"""`inkloop export layers`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import (
    add_overrides,
    add_part_options,
    no_part_options,
    overrides_of,
    scenario_of,
    scenario_of_part,
    screen,
)
from inkloop.errors import ResultError, require
from inkloop.exchange.layers import BITMAP_FORMATS, DROP_SPLITS

SCENARIOS = (".toml", ".ssp")


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "layers", help="write the droplet patterns of each layer as bitmaps, for print heads"
    )
    parser.add_argument(
        "scenario",
        type=Path,
        metavar="RUN|SCENARIO|FILE",
        help="run folder; or scenario (.toml, .ssp) or part (STL, OBJ, PLY, 3MF, height map), of which the planned "
        "open loop is written",
    )
    parser.add_argument("--format", choices=BITMAP_FORMATS, default="tiff", help="default: tiff, Group 4")
    parser.add_argument("--passes", action="store_true", help="separate the passes of a layer")
    parser.add_argument(
        "--drop-levels",
        choices=DROP_SPLITS,
        help="bitmaps of drops of several sizes: one for each size, or one for each bit of the level (default: planes)",
    )
    parser.add_argument("--layers", metavar="A-B", help="layers to write, from 1 (default: all)")
    parser.add_argument("-o", "--out", type=Path, metavar="DIR", help="new folder to write (default: NAME-layers)")
    add_overrides(parser)
    add_part_options(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Write the folder; the exit code."""
    require("PIL", "inkloop export layers")
    from inkloop.exchange.layers import archive, patterns
    from inkloop.results.result import Result

    source: Path = options.scenario
    if source.is_file() and source.suffix not in SCENARIOS:
        scenario = scenario_of_part(options, source, overrides_of(options.overrides, str(source)))
        return archive.export(patterns.of_open_loop(scenario), source, options, screen(options))
    no_part_options(options)
    if not source.is_dir():
        with scenario_of(options) as scenario:
            return archive.export(patterns.of_open_loop(scenario), source, options, screen(options))
    if options.overrides:
        raise ResultError(f"{source}: --set goes with a scenario; a run keeps what was jetted: leave it out")
    return archive.export(patterns.of_run(Result.load(source), str(source)), source, options, screen(options))

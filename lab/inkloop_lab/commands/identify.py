"""`inkloop identify`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, add_pictures, formats_of, overrides_of, screen


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "identify", help="identify an ink from logged prints, runs, or experiments on a plant; writes an ink file"
    )
    parser.add_argument(
        "sources",
        nargs="+",
        metavar="SOURCE",
        help="folders of logged prints (with print.toml) or run folders; or, for experiments, one "
        "scenario, .fmu file or kind of plant",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="ink file to write (default: NAME-ink.toml)")
    parser.add_argument(
        "--noise-um",
        type=float,
        metavar="UM",
        help="standard deviation of a height reading (default: estimated from cells without droplets; "
        "0.3 in experiments on an .fmu file or kind)",
    )
    parser.add_argument(
        "--reach",
        type=int,
        default=1,
        choices=(1, 2, 3),
        help="2 or 3: also fit a plant whose droplets reach that many cells far and keep their volume (default: 1)",
    )
    parser.add_argument(
        "--samples", type=int, default=75, metavar="N", help="experiments: samples of each droplet motif (default: 75)"
    )
    parser.add_argument(
        "--layers", type=int, default=6, metavar="N", help="experiments: layers with many droplets (default: 6)"
    )
    parser.add_argument(
        "--side", type=int, default=32, metavar="N", help="experiments: cells along a side (default: 32)"
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        metavar="N",
        help="seed of the experiments and of the groups of samples (default: 0)",
    )
    parser.add_argument("--runs", type=Path, metavar="DIR", help="experiments: keep the run folders there")
    add_pictures(parser)
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Identify, show and write; the exit code."""
    from inkloop.scenario.packaged import classes_from
    from inkloop_lab.identify import command

    options.pictures = formats_of(options)
    source = options.sources[0]
    with classes_from(Path(source).parent):
        return command.run(options, overrides_of(options.overrides, source), screen(options))

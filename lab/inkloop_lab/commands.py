"""`inkloop identify`, `reproduce`, `score` and `sweep`, see `inkloop.commands`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands import Part
from inkloop.commands.options import add_overrides, add_pictures, formats_of, overrides_of, screen
from inkloop.errors import require
from inkloop_lab.reproduce import PAPERS
from inkloop_lab.score import PLANTS


def _add_identify(commands: Any) -> argparse.ArgumentParser:
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


def _identify(options: argparse.Namespace) -> int:
    """Identify, show and write; the exit code."""
    from inkloop.scenario.packaged import classes_from
    from inkloop_lab.identify import command

    options.pictures = formats_of(options)
    source = options.sources[0]
    with classes_from(Path(source).parent):
        return command.run(options, overrides_of(options.overrides, source), screen(options))


def _add_reproduce(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "reproduce", help="recompute the figures of a paper and compare them with the published ones"
    )
    parser.add_argument("paper", choices=tuple(PAPERS), metavar="PAPER", help=f"one of {', '.join(PAPERS)}")
    parser.add_argument("--quick", action="store_true", help="fewer prints and coarser grids: half a minute at most")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder for tables and pictures (default: runs/PAPER)"
    )
    add_pictures(parser)
    return parser


def _reproduce(options: argparse.Namespace) -> int:
    """Compute and compare; the exit code."""
    require("matplotlib", "inkloop reproduce")
    from inkloop_lab.reproduce.comparison import reproduce

    return reproduce(options, screen(options))


def _add_score(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "score", help="compare controllers, including yours, on the plants of the score board"
    )
    parser.add_argument(
        "controller",
        nargs="?",
        metavar="MODULE:CLASS",
        help="your controller, as `kind` in a scenario; env:MODULE:CLASS: a policy (default: all of inkloop's)",
    )
    add_overrides(parser, "option of your controller")
    parser.add_argument(
        "--plant",
        action="append",
        default=[],
        metavar="PLANT",
        dest="plants",
        help=f"print on this plant only; may be repeated: {', '.join(PLANTS)}, also without the version",
    )
    parser.add_argument("--quick", action="store_true", help="one seed instead of three")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder for tables and picture (default: runs/score)"
    )
    add_pictures(parser)
    return parser


def _score(options: argparse.Namespace) -> int:
    """Print on all plants, and show the scores; the exit code."""
    from inkloop.scenario.packaged import classes_from

    require("matplotlib", "inkloop score")
    from inkloop_lab.score import command

    with classes_from(Path.cwd()):
        return command.score(options, overrides_of(options.overrides, "score"), screen(options))


def _add_sweep(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "sweep", help="print a scenario with many settings and seeds: which of them matter, which are best"
    )
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (.toml): scenario, keys, seeds")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="new folder (default: runs/NAME, or runs/NAME-2, ... if that exists)"
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="continue a study however it was stopped, in --out (default: the last of runs/NAME, runs/NAME-2, ...)",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=int, metavar="N", help="prints at a time, in processes (default: as many as there are cores)"
    )
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="print on a running Dask cluster, e.g. tcp://10.0.0.1:8786"
    )
    parser.add_argument("--check", action="store_true", help="check the study and count its prints; print nothing")
    add_pictures(parser)
    return parser


def _sweep(options: argparse.Namespace) -> int:
    """Print the study and say what it found; the exit code, 3 where prints have failed."""
    from inkloop_lab.sweep import command

    options.pictures = () if options.check else formats_of(options)
    return command.sweep(options, screen(options))


IDENTIFY = Part(_add_identify, _identify)
REPRODUCE = Part(_add_reproduce, _reproduce)
SCORE = Part(_add_score, _score)
SWEEP = Part(_add_sweep, _sweep)

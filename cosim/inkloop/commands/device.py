"""`inkloop device`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, overrides_of, scenario_of, screen

ACTIONS = {
    "stop": "ask all nodes to de-energise, also while a print runs; no emergency stop",
    "release": "end the stop request of a person; the nodes stay off until clear",
    "status": "show what every node does and remembers; changes nothing",
    "clear": "release the nodes after a person has inspected the bench; with --give-up abandon the open layer",
    "home": "move the stage to its reference position",
    "purge": "purge the print head",
    "dry-run": "run one whole layer without jetting and curing",
}


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    actions = "\n".join(f"  {name:<8} {meaning}" for name, meaning in ACTIONS.items())
    parser: argparse.ArgumentParser = commands.add_parser(
        "device",
        help="inspect or operate the nodes of a bench without printing",
        description=f"Inspect or operate the nodes of a bench without printing. Actions:\n{actions}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "scenario", type=Path, metavar="SCENARIO|RUN", help="scenario file (.toml) with a [bench], or a run folder"
    )
    parser.add_argument("action", choices=tuple(ACTIONS), metavar="ACTION", help=f"one of {', '.join(ACTIONS)}")
    parser.add_argument("--give-up", action="store_true", help="with clear: abandon the open layer")
    add_overrides(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Do the action; the exit code."""
    from inkloop.bench.commands import act

    folder: Path = options.scenario
    if not folder.is_dir():
        with scenario_of(options) as scenario:
            return act(scenario, options, screen(options))
    from inkloop.printing.run import scenario_file, scenario_of_run
    from inkloop.scenario.class_path import classes_from

    with classes_from(scenario_file(folder).parent):
        return act(scenario_of_run(folder, overrides_of(options.overrides, str(folder))), options, screen(options))

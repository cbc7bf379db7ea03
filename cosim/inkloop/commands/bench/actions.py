"""`inkloop bench status`, `stop` and others: one action of a person on the nodes of a bench."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_overrides, overrides_of, scenario_of, screen


@dataclass(frozen=True)
class Action:
    """A command for one action. help: what it does."""

    name: str
    help: str

    def add_parser(self, commands: Any) -> argparse.ArgumentParser:
        """The parser of the command."""
        parser: argparse.ArgumentParser = commands.add_parser(self.name, help=self.help)
        parser.add_argument(
            "scenario", type=Path, metavar="SCENARIO|RUN", help="scenario file (.toml) with a [bench], or a run folder"
        )
        if self.name == "clear":
            parser.add_argument("--give-up", action="store_true", help="abandon the open layer")
        add_overrides(parser)
        return parser

    def run(self, options: argparse.Namespace) -> int:
        """Do the action; the exit code."""
        from inkloop.bench.commands import act

        give_up = self.name == "clear" and options.give_up
        folder: Path = options.scenario
        if not folder.is_dir():
            with scenario_of(options) as scenario:
                return act(scenario, self.name, screen(options), give_up=give_up)
        from inkloop.printing.run import scenario_file, scenario_of_run
        from inkloop.scenario.class_path import classes_from

        with classes_from(scenario_file(folder).parent):
            scenario = scenario_of_run(folder, overrides_of(options.overrides, str(folder)))
            return act(scenario, self.name, screen(options), give_up=give_up)


ACTIONS = (
    Action("status", "show what every node does and remembers; changes nothing"),
    Action("stop", "ask all nodes to de-energise, also while a print runs; no emergency stop"),
    Action("release", "end the stop request of a person; the nodes stay off until clear"),
    Action("clear", "release the nodes after a person has inspected the bench"),
    Action("home", "move the stage to its reference position"),
    Action("purge", "purge the print head"),
    Action("dry-run", "run one whole layer without jetting and curing"),
)

"""`inkloop bench`: the nodes of a bench, emulated or real, without printing."""

from __future__ import annotations

import argparse
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

from inkloop.commands import Part
from inkloop.commands.options import add_overrides, overrides_of, scenario_of, screen, show_error
from inkloop.errors import ScenarioError

ACTIONS = {
    "status": "show what every node does and remembers; changes nothing",
    "stop": "ask all nodes to de-energise, also while a print runs; no emergency stop",
    "release": "end the stop request of a person; the nodes stay off until clear",
    "clear": "release the nodes after a person has inspected the bench",
    "home": "move the stage to its reference position",
    "purge": "purge the print head",
    "dry-run": "run one whole layer without jetting and curing",
}
"""Action of a person on the nodes -> its help."""
CANNOT_RUN = 2
"""Exit code of the doctor where the scenario cannot be read."""


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command, which its parts are added to."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "bench", help="emulate, inspect or operate the nodes of a bench without printing"
    )
    return parser


def _add_emulate(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "emulate", help="run the bench emulator: four nodes on a CAN bus of this machine"
    )
    _add_scenario(parser, "SCENARIO", "scenario file (.toml) that sets grid, ink and sensor", nargs="?")
    parser.add_argument(
        "--port", type=int, metavar="N", help="TCP port on 127.0.0.1 (default: the port of [bench] in the scenario)"
    )
    parser.add_argument("--pty", action="store_true", help="use a pseudo-terminal instead of a port")
    parser.add_argument("--folder", type=Path, metavar="DIR", help="keep journals and surface in this folder")
    parser.add_argument(
        "--fault",
        action="append",
        default=[],
        metavar="FAULT",
        help="fault to inject, as KIND[:key=value,...], e.g. loss:probability=1e-3; may be repeated; "
        "docs/reference/bench-faults.md lists all",
    )
    add_overrides(parser)
    return parser


def _emulate(options: argparse.Namespace) -> int:
    """Run the emulator until Ctrl-C; the exit code."""
    from inkloop.bench.commands import emulate

    with ExitStack() as stack:
        scenario = stack.enter_context(scenario_of(options)) if options.scenario else None
        return emulate(scenario, options, screen(options))


def _add_action(action: str, commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(action, help=ACTIONS[action])
    _add_scenario(parser, "SCENARIO|RUN", "scenario file (.toml) with a [bench], or a run folder")
    if action == "clear":
        parser.add_argument("--give-up", action="store_true", help="abandon the open layer")
    add_overrides(parser)
    return parser


def _act(action: str, options: argparse.Namespace) -> int:
    """Do an action; the exit code."""
    from inkloop.bench.commands import act

    give_up = action == "clear" and options.give_up
    if not options.scenario.is_dir():
        with scenario_of(options) as scenario:
            return act(scenario, action, screen(options), give_up=give_up)
    from inkloop.printing.run import scenario_of_run

    with scenario_of_run(options.scenario, overrides_of(options.overrides, str(options.scenario))) as scenario:
        return act(scenario, action, screen(options), give_up=give_up)


def _add_doctor(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "doctor",
        help="check a bench: adapter, bus, nodes and their messages; gives advice on every finding",
        description="Check a bench. Exit code 0: ready to print; 1: errors found; 2: the scenario cannot be read.",
    )
    about = "scenario file (.toml) with a [bench] (default: the bus of python-can's configuration)"
    _add_scenario(parser, "SCENARIO", about, nargs="?")
    parser.add_argument("--self-test", action="store_true", help="also test gate and lamp, after confirmation")
    parser.add_argument("--yes", action="store_true", help="with --self-test: do not ask")
    add_overrides(parser)
    return parser


def _examine(options: argparse.Namespace) -> int:
    """Check the bench and show the findings; the exit code."""
    from inkloop.bench.doctor import examine

    with ExitStack() as stack:
        try:
            scenario = stack.enter_context(scenario_of(options)) if options.scenario else None
        except ScenarioError as error:
            show_error(error, options)
            return CANNOT_RUN
        return examine(scenario, options, screen(options))


def _add_replay(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "replay",
        help="repeat a run on devices from its traffic log, without a bus",
        description="Repeat a run on devices from its traffic log, without a bus. Exit code 0: the master sends the "
        "same requests again; 1: it does not, or the log cannot be used.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder with its traffic log")
    parser.add_argument("--log", type=Path, metavar="FILE", help="another log, .blf or .asc (default: the log of RUN)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="keep the replayed run in this new folder")
    add_overrides(parser)
    return parser


def _replay(options: argparse.Namespace) -> int:
    """Replay and compare; the exit code."""
    from inkloop.bench.replay import replay

    return replay(options, overrides_of(options.overrides, str(options.run)), screen(options))


def _add_scenario(parser: argparse.ArgumentParser, metavar: str, about: str, nargs: str | None = None) -> None:
    parser.add_argument("scenario", type=Path, nargs=nargs, metavar=metavar, help=about)


PARTS = (
    Part(_add_emulate, _emulate),
    *(Part(partial(_add_action, action), partial(_act, action)) for action in ACTIONS),
    Part(_add_doctor, _examine),
    Part(_add_replay, _replay),
)

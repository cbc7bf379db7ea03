"""The commands by what they work on, each `add_parser` and `run`. An implementation is imported when its command runs.

A command with parts has `PARTS`, with the same two names each, in place of `run`. A package adds a command by an
entry point of the group "inkloop.commands": the name of the command, and such a module or a `Part`.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

__all__ = ["Part"]


class Part(NamedTuple):
    """One of the commands below a command: what adds its parser, and what runs it and returns the exit code."""

    add_parser: Callable[[Any], argparse.ArgumentParser]
    run: Callable[[argparse.Namespace], int]

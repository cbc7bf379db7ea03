"""Suggestions for unknown options: options of the command, or keys of its scenario."""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from inkloop.errors import OFFERED_MAX, InkloopError, near


def suggestion(unknown: Sequence[str], options: argparse.Namespace) -> str:
    """The nearest options, or keys of the scenario as --set gives them, for unknown options; "" if none is alike."""
    known = sorted(set(re.findall(r"--[a-z][a-z-]*", options.parser.format_help())))
    takes_keys = "scenario" in options and "overrides" in options
    meant: list[str] = []
    for word in (each.partition("=")[0] for each in unknown if each.startswith("-") and each.strip("-")):
        name, keys = word.lstrip("-").replace("-", "_"), _keys(options.scenario) if takes_keys else {}
        begun = [name] if name in keys else [last for last in keys if last.startswith(f"{name}_")]
        meant += (
            [option for option in known if option.startswith(word)]
            or [_setting(keys[last], word, options.words) for last in begun[:OFFERED_MAX]]
            or near(word, known)
            or [_setting(keys[last], word, options.words) for last in near(name, keys)]
        )
    return f"; did you mean {' or '.join(dict.fromkeys(meant))}?" if meant else ""


@cache
def _keys(path: Path | None) -> dict[str, str]:
    """Last word of each key of a scenario -> the whole key, of equal ones the first of those in the fewest tables."""
    from inkloop.files import TomlError, read_toml_text, toml_tables
    from inkloop.scenario.json_schema import keys_of
    from inkloop.scenario.packaged import resolve

    raw: dict[str, Any] = {}
    first: dict[str, str] = {}
    with suppress(OSError, TomlError, InkloopError):  # its components are unknown then
        raw = toml_tables(read_toml_text(resolve(path))) if path else {}
    with suppress(InkloopError):
        for key in sorted(keys_of(raw), key=lambda key: key.count(".")):
            first.setdefault(key.rpartition(".")[2], key)
    return first


def _setting(key: str, word: str, words: Sequence[str]) -> str:
    """The --set that gives a key the value of an unknown option; words: of the command line."""
    place = next(number for number, each in enumerate(words) if each.partition("=")[0] == word)
    _, joined, value = words[place].partition("=")
    if not joined:
        is_given = place + 1 < len(words) and not words[place + 1].startswith("--")
        value = words[place + 1] if is_given else "VALUE"
    return f"--set {shlex.quote(f'{key}={value}')}"

"""Errors that FMPy finds in an FMU, each variable name parsed once per process.

FMPy builds its parser of names anew for each FMU and parses every name of it, most of the time of its check. Whether a
name is legal depends on the grammar and the name alone: one that was legal in an FMU is legal in the next.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from fmpy.validation import validate_fmu
from lark import Lark


@cache
def _parse_once(grammar: str, start: str) -> Callable[[str], Any]:
    """The parser of a grammar; an illegal name raises each time, as `cache` keeps no errors."""
    return cache(Lark(grammar, start=start).parse)


def by_fmpy(file: Path) -> list[str]:
    """`fmpy validate`: one sentence per error, none for a valid FMU."""
    with patch("lark.Lark", lambda grammar, start: SimpleNamespace(parse=_parse_once(grammar, start))):
        errors: list[str] = validate_fmu(str(file))
    return errors

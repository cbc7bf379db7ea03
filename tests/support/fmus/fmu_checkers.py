"""Errors that third-party checkers find in an FMU: a list of sentences each, empty if there are none."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from fmpy.validation import validate_fmu
from fmu_manipulation_toolbox.checker import get_checkers
from fmu_manipulation_toolbox.operations import FMU
from lark import Lark

from support.masters.java_programs import VDM_CHECK


@cache
def _parse_once(grammar: str, start: str) -> Callable[[str], Any]:
    """The parser of a grammar; an illegal name raises each time, as `cache` keeps no errors."""
    return cache(Lark(grammar, start=start).parse)


def by_fmpy(file: Path) -> list[str]:
    """`fmpy validate`, each name parsed once per process: FMPy spends most of its check on parsing all names anew.

    Whether a name is legal depends on the grammar and the name alone.
    """
    with patch("lark.Lark", lambda grammar, start: SimpleNamespace(parse=_parse_once(grammar, start))):
        errors: list[str] = validate_fmu(str(file))
    return errors


class _Kept(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


def by_fmutool(file: Path) -> list[str]:
    """`fmutool -input file -check`: the schema, and rules of the standard that a schema cannot express."""
    logger, kept = logging.getLogger("fmu_manipulation_toolbox"), _Kept()
    logger.addHandler(kept)
    try:
        with FMU(str(file)) as opened:
            for checker in get_checkers():
                opened.apply_operation(checker())
    finally:
        logger.removeHandler(kept)
    return kept.messages


def by_vdm_check(file: Path) -> list[str]:
    """VDMCheck2, the rules of FMI 2 in VDM-SL; the address of the rule stands below each fault, and is left out."""
    with tempfile.TemporaryDirectory() as folder:
        done = VDM_CHECK.run("VDMCheckPlus", str(file.resolve()), folder=Path(folder))
    if done.returncode == 0 and "No errors found" in done.stdout:
        return []
    return [line for line in done.stdout.splitlines() if not line.startswith("https:")]

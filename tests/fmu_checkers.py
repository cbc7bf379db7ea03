"""What checkers of other people find wrong with an FMU: a list of sentences each, empty where it is right."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path

from fmpy.validation import validate_fmu
from fmu_manipulation_toolbox.checker import get_checkers
from fmu_manipulation_toolbox.operations import FMU


class _Kept(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


def by_fmpy(file: Path) -> list[str]:
    """`fmpy validate`."""
    problems: list[str] = validate_fmu(str(file))
    return problems


def by_fmutool(file: Path) -> list[str]:
    """`fmutool -input file -check`: the schema, and rules of the standard that a schema cannot tell."""
    logger, kept = logging.getLogger("fmu_manipulation_toolbox"), _Kept()
    logger.addHandler(kept)
    try:
        with FMU(str(file)) as opened:
            for checker in get_checkers():
                opened.apply_operation(checker())
    finally:
        logger.removeHandler(kept)
    return kept.messages


CHECKERS: dict[str, Callable[[Path], list[str]]] = {"`fmpy validate`": by_fmpy, "`fmutool -check`": by_fmutool}

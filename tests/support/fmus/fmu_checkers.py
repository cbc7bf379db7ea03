"""Errors that third-party checkers find in an FMU: a list of sentences each, empty if there are none."""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path

from fmu_manipulation_toolbox.checker import get_checkers
from fmu_manipulation_toolbox.operations import FMU

from support.masters.java_programs import VDM_CHECK


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

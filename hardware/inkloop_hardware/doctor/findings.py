"""What a look at a bench brings: one finding for each check, with what to do about it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum


class Grade(StrEnum):
    """How a check ended."""

    GOOD = "good"
    NOTE = "note"
    """worth knowing, nothing stands in the way of a print"""
    FAULT = "fault"
    """to be mended first"""
    LEFT_OUT = "left out"
    """not looked at, and why"""


@dataclass(frozen=True)
class Finding:
    """check: what was looked at; found, advice: sentences; advice is empty where nothing is to be done."""

    check: str
    grade: Grade
    found: str
    advice: str = ""

    def to_json(self) -> dict[str, str]:
        """For other programs."""
        return {name: str(value) for name, value in asdict(self).items()}


def good(check: str, found: str) -> Finding:
    """Nothing to do."""
    return Finding(check, Grade.GOOD, found)


def note(check: str, found: str, advice: str = "") -> Finding:
    """Worth knowing."""
    return Finding(check, Grade.NOTE, found, advice)


def fault(check: str, found: str, advice: str) -> Finding:
    """To be mended."""
    return Finding(check, Grade.FAULT, found, advice)


def left_out(check: str, why: str, advice: str = "") -> Finding:
    """Not looked at."""
    return Finding(check, Grade.LEFT_OUT, why, advice)

"""Results of an examination: one finding for each check, with advice."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Self


class Grade(StrEnum):
    """Result of a check."""

    OK = "ok"
    WARNING = "warning"
    """Worth knowing; a print can start."""
    ERROR = "error"
    """Must be corrected before a print."""
    SKIPPED = "skipped"
    """Not checked; the finding gives the reason."""


@dataclass(frozen=True)
class Finding:
    """check: what was examined; found, advice: sentences; advice is empty if no action is needed."""

    check: str
    grade: Grade
    found: str
    advice: str = ""

    @classmethod
    def ok(cls, check: str, found: str) -> Self:
        """A check that passed."""
        return cls(check, Grade.OK, found)

    @classmethod
    def warning(cls, check: str, found: str, advice: str = "") -> Self:
        """Something worth knowing that does not prevent a print."""
        return cls(check, Grade.WARNING, found, advice)

    @classmethod
    def error(cls, check: str, found: str, advice: str) -> Self:
        """Something that must be corrected before a print."""
        return cls(check, Grade.ERROR, found, advice)

    @classmethod
    def skipped(cls, check: str, reason: str, advice: str = "") -> Self:
        """A check that was not made."""
        return cls(check, Grade.SKIPPED, reason, advice)

    def to_json(self) -> dict[str, str]:
        """For other programs."""
        return {name: str(value) for name, value in asdict(self).items()}

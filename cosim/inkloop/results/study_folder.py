"""The folder of a study, for those that find one in place of a run."""

from __future__ import annotations

from pathlib import Path

__all__ = ["STUDY_STATE_FILE", "study_in"]

STUDY_STATE_FILE = "study.json"
"""File that `inkloop sweep` keeps in the folder of a study."""


def study_in(folder: Path) -> str:
    """That a folder is that of a study, and the command that reads it; "" if it is not."""
    again = f"`inkloop sweep STUDY --out {folder} --resume` continues it, or shows what it found"
    return f"is the folder of a study; {again}" if (folder / STUDY_STATE_FILE).is_file() else ""

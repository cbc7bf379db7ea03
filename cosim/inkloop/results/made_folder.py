"""A folder that inkloop has made, for the message where a person names it in place of something else."""

from __future__ import annotations

from pathlib import Path

from inkloop.errors import ResultError
from inkloop.results.result import RUN_FILE, UNFINISHED, read_record
from inkloop.results.study_folder import study_in

__all__ = ["made_folder"]


def made_folder(folder: Path) -> str:
    """The kind of a folder that inkloop has made, and the command that reads or continues it; "" for another folder."""
    if not (folder / RUN_FILE).is_file():
        return study_in(folder)
    try:
        record = read_record(folder)
    except ResultError:
        return f"is the folder of a run that cannot be read; `inkloop info {folder}` says why"
    origin, reason = record.get("scenario_file", "another scenario"), record.get("stop_reason")
    if reason in UNFINISHED:
        return f"is the folder of a run of {origin}; `inkloop resume {folder}` continues it"
    return f"is the folder of a run of {origin} that has ended ({reason}); `inkloop report {folder}` shows it"

"""Advice on a run whose command has ended before its time: what of it is on disk, and how to go on with it."""

from __future__ import annotations

from pathlib import Path

from inkloop.results import checkpoint
from inkloop.results.result import RUN_FILE, UNFINISHED, read_record


def unfinished(folder: Path) -> dict[Path, str]:
    """The prints in a run folder that have begun and not finished -> their stop reason, the run itself first."""
    places = sorted(path.parent for path in folder.rglob(RUN_FILE))
    reasons = {place: str(read_record(place).get("stop_reason")) for place in places}
    return {place: reason for place, reason in reasons.items() if reason in UNFINISHED}


def advice_on(folder: Path, before: str = "") -> str:
    """The layers on disk and how to go on with the run; before: what to do first, such as "fix the cause, then "."""
    if not (folder / RUN_FILE).is_file():
        return f"nothing was printed yet; {before}run it again"
    again = f"{before}continue with `inkloop resume {folder}`"
    place = next(iter(unfinished(folder)), None)
    if place is None:
        return f"prints that have ended are in {folder}; {again}, or show them with `inkloop report {folder}`"
    last = checkpoint.last(place)
    if last is None:
        return f"no layer was finished; {again}"
    kept = f"layers 0 to {last.layer} are in {place}"
    return f"{kept}; the run cannot be resumed: {last.refusal}" if last.refusal else f"{kept}; {again}"

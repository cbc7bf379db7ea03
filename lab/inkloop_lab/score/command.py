"""`inkloop score`: compare inkloop's controllers, or the user's with them, on the plants of the score board."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib import rc_context

from inkloop.components.catalog import kinds
from inkloop.errors import InkloopError, ResultError, ScenarioError, nearest
from inkloop.files import write_text
from inkloop.printing.run import INTERRUPTED, new_run_folder
from inkloop.report import plot
from inkloop.report.terminal import Terminal
from inkloop.results.lock import sole_writer
from inkloop_lab.score import PLANTS, tables
from inkloop_lab.score.board import (
    AGAINST,
    ENTRIES,
    SEEDS,
    Entry,
    Score,
    load,
    named,
    overrides_of,
    prints,
)


def score(options: argparse.Namespace, overrides: Mapping[str, Any], console: Terminal) -> int:
    """The exit code of the command; overrides: options of the user's controller. Raises InkloopError."""
    entries = list(ENTRIES)
    if options.controller is not None:
        known = {entry.kind for entry in ENTRIES}
        if ":" not in options.controller and options.controller not in kinds():
            advice = f"write MODULE:CLASS, or a kind; {nearest(options.controller, known)}"
            raise InkloopError(f"there is no controller {options.controller!r}; {advice}")
        own = Entry(options.controller, options.controller, overrides)
        entries = [*AGAINST, own]
        try:  # its errors are reported before anything is printed
            load(PLANTS[0], overrides_of(own))
        except ScenarioError as error:
            raise ScenarioError(options.controller, error.errors) from error
    elif overrides:
        raise InkloopError("--set is for a controller of your own; name it, as MODULE:CLASS or by its kind")
    plants = [named(plant) for plant in options.plants]
    seeds = SEEDS[:1] if options.quick else SEEDS
    folder = new_run_folder(options.out, "score")
    with sole_writer(folder):
        return _scored(entries, plants or PLANTS, seeds, folder, options.pictures, console)


def _scored(
    entries: Sequence[Entry],
    plants: Sequence[str],
    seeds: Sequence[int],
    folder: Path,
    pictures: Sequence[str],
    console: Terminal,
) -> int:
    """Print all, then write and show the tables of what was printed; the open loop is the first entry of a plant."""
    found, interrupted = _all(entries, plants, seeds, console)
    if found:
        write(folder, found, seeds, pictures)
        for version, own in tables.by_version(found).items():
            console.print(tables.terminal_table(version, own))
            console.sentence(tables.how_to_cite(version, seeds))
        written = "tables and picture" if pictures else "tables"
        console.sentence(f"{'interrupted' if interrupted else 'done'}: {written} are in {folder}/")
    elif interrupted:
        console.sentence("interrupted: nothing is finished")
    console.result(folder=folder, interrupted=interrupted, scores=[_record(one) for one in found])
    return INTERRUPTED if interrupted else 0


def _all(
    entries: Sequence[Entry], plants: Sequence[str], seeds: Sequence[int], console: Terminal
) -> tuple[list[Score], bool]:
    """All scores, plant by plant, or those up to Ctrl-C."""
    found: list[Score] = []
    with console.progress() as progress:
        task = progress.add_task("", total=len(entries) * len(plants))
        for plant in plants:
            for entry in entries:
                progress.update(task, description=f"{plant}: {entry.name}")
                try:
                    found.append(prints(entry, plant, seeds))
                except KeyboardInterrupt:
                    return found, True
                progress.advance(task)
    return found, False


def _record(score: Score) -> dict[str, Any]:
    """One score as plain values: means over the seeds, lengths in µm."""
    figures = {metric: score.mean(metric) for metric in score.figures}
    return {"controller": score.entry.name, "plant": score.plant, **figures}


def write(folder: Path, scores: Sequence[Score], seeds: Sequence[int], pictures: Sequence[str]) -> None:
    """Write score.md, score.tex, score.csv and the picture in each format. Raises ResultError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "score.md", tables.markdown(scores, seeds))
        write_text(folder / "score.tex", tables.latex(scores, seeds))
        write_text(folder / "score.csv", tables.spreadsheet(scores, seeds))
        if pictures:
            with rc_context(plot.STYLE):
                plot.save(tables.picture(scores), folder / "score", pictures)
    except OSError as error:
        raise ResultError(f"{folder}: the tables cannot be written there: {error}") from error

"""`inkloop reproduce`: run the steps of a paper and write the results to a run folder."""

from __future__ import annotations

import argparse
import importlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter

from matplotlib import rc_context

from inkloop import __version__
from inkloop.errors import ResultError
from inkloop.files import write_text
from inkloop.printing.run import INTERRUPTED, new_run_folder
from inkloop.report import plot
from inkloop.report.terminal import Terminal
from inkloop_lab.reproduce import PAPERS
from inkloop_lab.reproduce.comparison import HEADINGS, Paper, Part, markdown, remarks, spreadsheet, terminal_table


def reproduce(options: argparse.Namespace, console: Terminal) -> int:
    """The exit code of the command; after Ctrl-C the folder holds the steps that are done. Raises ResultError."""
    paper: Paper = importlib.import_module(f"inkloop_lab.reproduce.{PAPERS[options.paper]}").PAPER
    folder = new_run_folder(options.out, paper.name)
    parts: dict[str, Part] = {}
    seconds: dict[str, float] = {}
    interrupted = False
    with console.progress() as progress:
        task = progress.add_task(paper.name, total=len(paper.steps))
        for step in paper.steps:
            progress.update(task, description=step.name)
            begin = perf_counter()
            try:
                with rc_context(plot.STYLE):
                    parts[step.name] = step.find(options.quick)
            except KeyboardInterrupt:
                interrupted = True
                break
            seconds[step.name] = perf_counter() - begin
            progress.advance(task)
            write(folder, paper, parts, {"quick": options.quick, "seconds": seconds}, options.pictures)
    rows = [row for part in parts.values() for row in part.rows]
    console.print(terminal_table(f"{paper.name}: printed and ours", rows))
    for remark in remarks(rows):
        console.sentence(f"- {remark}")
    done = "interrupted" if interrupted else "done"
    held = "what is finished is" if interrupted else "table, pages and pictures are"
    console.sentence(f"{done}: {held} in {folder}/")
    console.result(
        folder=folder, interrupted=interrupted, rows=[dict(zip(HEADINGS, row.cells, strict=True)) for row in rows]
    )
    return INTERRUPTED if interrupted else 0


def write(
    folder: Path, paper: Paper, parts: dict[str, Part], notes: dict[str, object], pictures: Sequence[str]
) -> None:
    """Write the table (.txt, .md, .csv), the pictures and their origin. Raises ResultError."""
    rows = [row for part in parts.values() for row in part.rows]
    text = io.StringIO()
    page = Terminal(text, width=140)
    page.print(terminal_table(f"{paper.name}: printed and ours", rows))
    for remark in remarks(rows):
        page.print(f"- {remark}")
    record = {"inkloop": __version__, "paper": paper.reference, "steps": list(parts), **notes}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_text(folder / "table.txt", text.getvalue())
        write_text(folder / "table.md", markdown(paper.reference, rows))
        write_text(folder / "table.csv", spreadsheet(rows))
        write_text(folder / "reproduce.json", json.dumps(record, indent=2) + "\n")
        for name, figure in list(parts.values())[-1].pictures.items():
            plot.save(figure, folder / name, pictures)
    except OSError as error:
        raise ResultError(f"{folder}: the tables cannot be written there: {error}") from error

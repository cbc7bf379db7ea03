"""`inkloop report`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from inkloop.commands.options import add_pictures, formats_of, screen
from inkloop.errors import require


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "report", help="rewrite the tables and pictures of a run folder, or write one file with all of it"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, as written by `inkloop run`")
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--html", action="store_true", help="write report.html only: one page for a browser, with maps of every layer"
    )
    form.add_argument("--pdf", action="store_true", help="write report.pdf only: table, pictures and scenario")
    add_pictures(parser)
    return parser


def run(options: argparse.Namespace) -> int:
    """Write tables and pictures, or one file, and show the tables; the exit code."""
    from inkloop.report import run_report

    terminal = screen(options)
    if options.html or options.pdf:
        return _write_file(options)
    terminal.print(run_report.write(options.run, formats_of(options)))
    if (options.run / run_report.MODEL_TABLE).is_file():
        terminal.print((options.run / run_report.MODEL_TABLE).read_text(encoding="utf-8"))
    if terminal.as_json:
        terminal.result(**run_report.record(options.run))
    return 0


def _write_file(options: argparse.Namespace) -> int:
    """Write one file, also of a run that has not ended, whose other files stay as they are."""
    require("plotly" if options.html else "matplotlib", "report.html" if options.html else "report.pdf")
    from inkloop.limits import size_text
    from inkloop.printing.device_log import LOG_FILE
    from inkloop.printing.so_far import RunFolder
    from inkloop.report import run_report

    terminal, runs = screen(options), RunFolder(options.run).runs()
    summary = run_report.Summary.of(runs)
    if options.html:
        from inkloop.report.page import page

        path = options.run / page.FILE
        page.write(path, runs, options.run / LOG_FILE)
    else:
        from inkloop.report import pictures

        path = options.run / pictures.PDF_FILE
        pictures.write_pdf(path, runs, str(summary))
    terminal.print(summary.table)
    terminal.sentence(f"{path}: {size_text(path.stat().st_size)}")
    terminal.result(folder=options.run, file=path, runs=run_report.figures(runs))
    return 0

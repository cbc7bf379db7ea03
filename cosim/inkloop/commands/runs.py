"""`inkloop report`, `watch`, `compare`, `info` and `metrology`: runs, maps and FMUs that are there."""

from __future__ import annotations

import argparse
import errno
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.commands import Part
from inkloop.commands.options import add_pictures, formats_of, screen
from inkloop.errors import InkloopError, ScenarioError, require
from inkloop.metrology import UNITS
from inkloop.metrology.evaluation.definitions import F_OPERATIONS, MISSING_MAX
from inkloop.results import SURFACES


def _add_report(commands: Any) -> argparse.ArgumentParser:
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


def _report(options: argparse.Namespace) -> int:
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
    from inkloop.printing.on_devices import LOG_FILE
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


if TYPE_CHECKING:
    from inkloop.report.page.live import Feed, Server

PORT = 8050


def _add_watch(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "watch", help="show a run in a browser, layer by layer while it is printed"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, of a run that has ended or not")
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="N", help=f"port on this machine (default: {PORT}; 0: a free one)"
    )
    return parser


def _watch(options: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C; the exit code."""
    require("plotly", "inkloop watch")
    from inkloop.printing.so_far import feed_of

    feed = feed_of(options.run)
    with _server(feed, options.port) as server:
        terminal = screen(options)
        terminal.sentence(f"{options.run}: open {server.url} in a browser; Ctrl-C ends the view, not the print")
        terminal.result(folder=options.run, url=server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            terminal.sentence("the view has ended")
    return 0


def _server(feed: Feed, port: int) -> Server:
    """The server of a feed. Raises InkloopError where the port cannot be had."""
    from inkloop.report.page.live import Server

    if not 0 <= port < 65536:
        raise InkloopError(f"--port is {port}; expected a number from 0, any free port, to 65535")
    try:
        return Server(feed, port)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise InkloopError(
                f"port {port} is in use, perhaps by another inkloop watch; take another one with --port, or --port 0"
            ) from error
        raise InkloopError(f"port {port} cannot be opened: {error.strerror}; take another one with --port") from error


def _add_compare(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "compare", help="compare several runs on the same grid in one table and one picture"
    )
    parser.add_argument("runs", type=Path, nargs="+", metavar="RUN", help="run folder, as written by `inkloop run`")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("compare"),
        metavar="FILE",
        help="picture to write (default: compare.png); its suffix is a format, as of --pictures",
    )
    add_pictures(parser, default=None)
    return parser


def _compare(options: argparse.Namespace) -> int:
    """Show the table and write the picture; the exit code."""
    from inkloop.report import run_report

    terminal = screen(options)
    table, runs, pictures = run_report.compare(options.runs, options.out, formats_of(options))
    terminal.print(table)
    for picture in pictures:
        terminal.sentence(f"wrote {picture}")
    terminal.result(runs=runs, pictures=pictures)
    return 0


def _add_info(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser("info", help="describe an FMU or a run")
    parser.add_argument("path", type=Path, nargs="?", metavar="FMU|RUN", help="an .fmu file, or a run folder")
    parser.add_argument("--devices", action="store_true", help='list the devices for device = "gpu" instead')
    return parser


def _info(options: argparse.Namespace) -> int:
    """Show the lines of the description; the exit code."""
    if options.devices:
        require("pyopencl", "--devices")
        shown = import_module("inkloop_controller.gpu.device").lines()
    elif options.path is None:
        raise InkloopError("info: name an FMU or a run, or --devices")
    elif options.path.is_dir():
        from inkloop.report.run_report import lines

        shown = lines(options.path)
    elif options.path.suffix == ".toml" and options.path.is_file():
        raise InkloopError(f"{options.path}: is a scenario; `inkloop validate` describes it")
    elif not options.path.exists():
        raise InkloopError(f"{options.path}: is not there; name an .fmu file, or a folder that `inkloop run` has made")
    else:
        from inkloop.fmu.reading import describe
        from inkloop.scenario.plant_file import plant_of

        described = describe(options.path)
        shown = list(described.lines())
        with suppress(ScenarioError):  # it is no plant
            shown.append(f"as a plant: {plant_of(described).summary}; inkloop new NAME --plant {options.path}")
    terminal = screen(options)
    for line in shown:
        terminal.sentence(line)
    terminal.result(lines=shown)
    return 0


def _add_metrology(commands: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        "metrology", help="evaluate a surface: areal and profile parameters, form, outline, volume"
    )
    parser.add_argument("source", type=Path, metavar="RUN|MAP", help="run folder, or height map of a profiler")
    parser.add_argument("--layer", type=int, metavar="N", help="of a run: after N layers (default: last)")
    parser.add_argument("--map", choices=SURFACES, help="of a run: surface to evaluate (default: printed)")
    parser.add_argument(
        "--mask", metavar="part|all|FILE", help="cells that count; an NPY file (default: part of a run, all of a map)"
    )
    parser.add_argument("--s-filter-um", type=float, metavar="L", help="remove waves shorter than this (default: none)")
    parser.add_argument("--l-filter-um", type=float, metavar="L", help="remove waves longer than this (default: none)")
    parser.add_argument(
        "--filter-order",
        type=int,
        choices=(0, 1),
        default=1,
        help="regression order of the Gaussian filters: 0 keeps constants, 1 planes up to the edge (default: 1)",
    )
    parser.add_argument(
        "--f-operation",
        choices=F_OPERATIONS,
        default="plane",
        help="taken off the heights: nothing but their mean, the least-squares plane (default), a polynomial of second "
        "order, or the target of the run",
    )
    parser.add_argument(
        "--profile",
        nargs="?",
        const="x",
        choices=("x", "y"),
        help="profile parameters instead: of a file with one profile, or of the rows along this axis (default: x)",
    )
    parser.add_argument(
        "--missing",
        type=float,
        default=MISSING_MAX,
        metavar="MAX",
        help=f"share of the cells that may lack a height (default: {MISSING_MAX:g})",
    )
    parser.add_argument("--channel", metavar="NAME", help="name or number of one of several maps in a file")
    parser.add_argument("--unit", choices=UNITS, help="of the heights of a map that does not give it")
    parser.add_argument("--pixel-um", type=float, metavar="P", help="pixel spacing of a map that does not give it")
    parser.add_argument("--count-scale", type=float, metavar="H", help="height of one count, for whole-number maps")
    parser.add_argument("--invalid-value", type=float, metavar="V", help="number of a pixel without a height")
    return parser


def _metrology(options: argparse.Namespace) -> int:
    """Show the parameters; the exit code."""
    from dataclasses import replace

    from inkloop.errors import HeightMapError
    from inkloop.metrology.evaluation.subject import Subject
    from inkloop.report import surface_parameters
    from inkloop.results.result import Result
    from inkloop.results.surface import subject_of

    source, is_run = options.source, options.source.is_dir()
    alien = ("channel", "unit", "pixel_um", "count_scale", "invalid_value") if is_run else ("layer", "map")
    if given := [f"--{name.replace('_', '-')}" for name in alien if getattr(options, name) is not None]:
        raise HeightMapError(f"{source}: is a {'run' if is_run else 'map'}; leave {' and '.join(given)} out")
    mask = options.mask or ("part" if is_run else "all")
    if is_run:
        run_ = Result.load(source).dataset
        of_run = subject_of(run_, str(source), name=options.map or SURFACES[0], layer=options.layer)
        subject = replace(of_run, mask=surface_parameters.mask_of(of_run.map_, of_run.mask, mask))
    else:
        map_ = surface_parameters.read(options)
        subject = Subject(map_, surface_parameters.mask_of(map_, None, mask))
    return surface_parameters.show(subject, mask, options, screen(options))


PARTS = (
    Part(_add_report, _report),
    Part(_add_watch, _watch),
    Part(_add_compare, _compare),
    Part(_add_info, _info),
    Part(_add_metrology, _metrology),
)

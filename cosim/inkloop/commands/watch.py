"""`inkloop watch`."""

from __future__ import annotations

import argparse
import errno
from pathlib import Path
from typing import TYPE_CHECKING, Any

from inkloop.commands.options import screen
from inkloop.errors import InkloopError, require

if TYPE_CHECKING:
    from inkloop.report.page.live import Feed, Server

PORT = 8050


def add_parser(commands: Any) -> argparse.ArgumentParser:
    """The parser of the command."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "watch", help="show a run in a browser, layer by layer while it is printed"
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="run folder, of a run that has ended or not")
    parser.add_argument(
        "--port", type=int, default=PORT, metavar="N", help=f"port on this machine (default: {PORT}; 0: a free one)"
    )
    return parser


def run(options: argparse.Namespace) -> int:
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

"""`inkloop watch`."""

from __future__ import annotations

import argparse
import errno
import socket
from pathlib import Path
from typing import Any

from inkloop.commands.options import screen
from inkloop.errors import InkloopError, require

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
    for library in ("sse_starlette", "starlette", "uvicorn", "plotly"):
        require(library, "inkloop watch")
    from inkloop.printing.so_far import feed_of
    from inkloop.report.page import server

    feed = feed_of(options.run)
    with _listening(options.port) as listening:
        url = f"http://{server.HOST}:{listening.getsockname()[1]}/"
        terminal = screen(options)
        terminal.sentence(f"{options.run}: open {url} in a browser; Ctrl-C ends the view, not the print")
        terminal.result(folder=options.run, url=url)
        try:
            server.server(feed).run(sockets=[listening])
        except KeyboardInterrupt:
            terminal.sentence("the view has ended")
    return 0


def _listening(port: int) -> socket.socket:
    """A socket that listens on this machine. Raises InkloopError where the port cannot be had."""
    from inkloop.report.page.server import HOST

    if not 0 <= port < 65536:
        raise InkloopError(f"--port is {port}; expected a number from 0, any free port, to 65535")
    found = socket.socket()
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((HOST, port))
        found.listen()
    except OSError as error:
        found.close()
        if error.errno == errno.EADDRINUSE:
            raise InkloopError(
                f"port {port} is in use, perhaps by another inkloop watch; take another one with --port, or --port 0"
            ) from error
        raise InkloopError(f"port {port} cannot be opened: {error.strerror}; take another one with --port") from error
    return found

"""The live page: the newest content of a run folder, its changes for each page, and their server on this machine.

Open pages keep asking for the content.
"""

from __future__ import annotations

import secrets
import sys
import threading
from collections.abc import Callable, Mapping, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import parse_qs, urlsplit

from inkloop.errors import InkloopError
from inkloop.report.page import page
from inkloop.report.page.maps import LayerMaps
from inkloop.results.result import Result

LOOKS_PER_STATE = 8
"""Looks at the files per look at the lock of the run, which must not block a run that begins at that moment."""
ROOM = 1.5
"""Room for layers on a page, relative to the least number that the scenario needs: the last layers are not full."""
HOST = "127.0.0.1"
HOSTS = (HOST, "localhost")
"""Host names in a valid request; any other belongs to a site that resolves itself to this machine."""
DIGITS = 9
"""Largest number of digits in a number of layers sent by a page."""
HEADERS = {
    "Content-Security-Policy": f"{page.POLICY}; {page.LIVE_SOURCES}; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


class Source(Protocol):
    """A run folder that is read again and again, see `inkloop.printing.so_far`."""

    def stamps(self) -> Mapping[Path, object]:
        """The files that `runs` reads; equal if nothing has changed."""

    def runs(self) -> dict[str, Result]:
        """The run first, then its comparison runs, by name. Raises InkloopError."""


class Feed:
    """The newest content of `source`, which is read when a page asks.

    state: a sentence on a run that has not ended; log: of its devices, a file that may not exist; layers: expected for
    each run. A page gets all layers that it does not have yet, even after missed changes.
    """

    def __init__(self, source: Source, state: Callable[[], str], log: Path, layers: int) -> None:
        self._source, self._state, self._log, self._layers = source, state, log, layers
        self._lock = threading.Lock()
        self._seen: object = None
        self._runs: dict[str, Result] = {}
        self._maps: dict[str, LayerMaps] = {}
        self._block, self._looks, self._version = 0, 0, 0
        self._epoch, self._problem, self._owner = _new_epoch(), "", ""

    def content(self, version: str = "", epoch: str = "", known: Sequence[int] = ()) -> dict[str, Any] | None:
        """The content for a page that has this version, with so many layers of each run; None if nothing has changed.

        All layers if they are of another epoch.
        """
        with self._lock:
            self._look()
            if self._problem:
                return {"problem": self._problem}
            if (version, epoch) == (str(self._version), self._epoch):
                return None
            is_same = (epoch, len(known)) == (self._epoch, len(self._runs))
            try:
                found = page.content(self._runs, list(self._maps.values()), self._log, known if is_same else ())
            except InkloopError as error:  # a run has ended since the last look
                return {"problem": str(error)}
            found["texts"]["state"] = f"{found['texts']['state']} {self._owner}".rstrip()
            return {**found, "version": str(self._version), "epoch": self._epoch}

    def _look(self) -> None:
        """Read what has changed; after a problem, all of it."""
        try:
            if self._looks % LOOKS_PER_STATE == 0:
                self._owner = self._state()
            self._looks += 1
            seen = (self._owner, self._source.stamps(), _length(self._log))
            if seen != self._seen:
                self._take(self._source.runs())
                self._seen, self._problem = seen, ""
                self._version += 1
        except (InkloopError, OSError) as error:
            self._seen, self._problem = None, str(error)

    def _take(self, runs: dict[str, Result]) -> None:
        """Add the new layers to the maps; begin again where a run has fewer layers, or the blocks become too small."""
        expected = max(self._layers, *(result.dataset.sizes["layer"] for result in runs.values())) * len(runs)
        block = page.first_block(runs, page.CONTENT_BYTES_MAX / page.PACKED_SHARE, round(ROOM * expected))
        is_shorter = any(
            name in self._maps and len(self._maps[name].heights) > result.dataset.sizes["layer"]
            for name, result in runs.items()
        )
        if is_shorter or self._block < block:
            self._maps, self._epoch, self._block = {}, _new_epoch(), block
        for name, result in runs.items():
            if name not in self._maps:
                self._maps[name] = LayerMaps(result.dataset, self._block)
            elif self._runs.get(name) is not result:
                self._maps[name].extend(result.dataset)
        self._maps = {name: self._maps[name] for name in runs}
        self._runs = runs


def _new_epoch() -> str:
    """A text that no other epoch has, of this watcher or of another one that served an open page before."""
    return secrets.token_hex(8)


def _length(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0


class Server(ThreadingHTTPServer):
    """The server of a feed on a port of this machine, 0 for a free one. Raises OSError."""

    def __init__(self, feed: Feed, port: int) -> None:
        super().__init__((HOST, port), _Answers)
        self.feed, self.texts = feed, {**page.served(), "/favicon.ico": ""}

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{HOST}:{self.server_port}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A page that is closed while it is answered is no error."""
        if not isinstance(sys.exception(), ConnectionError):
            super().handle_error(request, client_address)


class _Answers(BaseHTTPRequestHandler):
    server: Server
    protocol_version = "HTTP/1.1"

    def do_GET(self) -> None:
        """Answer with a file of the page, or with the content that a page lacks."""
        url = urlsplit(self.path)
        if self.headers.get("Host", "").partition(":")[0] not in HOSTS:
            self.send_error(HTTPStatus.BAD_REQUEST, "Invalid host header")
        elif url.path == "/content":
            self._answer(self._content(parse_qs(url.query)), "application/json")
        elif url.path in self.server.texts:
            self._answer(self.server.texts[url.path], "text/javascript" if url.path != "/" else "text/html")
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def log_message(self, *_: Any) -> None:
        """Print nothing: a page asks twice a second."""

    def _content(self, query: dict[str, list[str]]) -> str:
        version, epoch, known = (query.get(name, [""])[0] for name in ("version", "epoch", "known"))
        counts = [int(count) for count in known.split(",") if count.isdecimal() and len(count) < DIGITS]
        found = self.server.feed.content(version, epoch, counts)
        return page.as_json(found) if found else ""

    def _answer(self, text: str, kind: str) -> None:
        body = text.encode()
        self.send_response(HTTPStatus.OK if body else HTTPStatus.NO_CONTENT)
        for name, value in {**HEADERS, "Content-Type": f"{kind}; charset=utf-8"}.items():
            self.send_header(name, value)
        if body:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

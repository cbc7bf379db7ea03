"""Serve the live page on this machine: the page, its scripts, and the content, for which open pages keep asking."""

from __future__ import annotations

import sys
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

from inkloop.report.page import page
from inkloop.report.page.feed import Feed

HOST = "127.0.0.1"
HOSTS = (HOST, "localhost")
"""Host names in a valid request; any other belongs to a site that resolves itself to this machine."""
DIGITS = 9
"""Largest number of digits in a number of layers sent by a page."""
HEADERS = {
    "Content-Security-Policy": f"{page.POLICY}; {page.LIVE_SOURCES}; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}


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

"""Serve the live page on this machine: the page, its scripts, the content, and a stream of events.

An event reports a change; the page then requests the content that it lacks. A slow page misses events, not layers and
delays no other: the process that prints does not know of any of this.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio
import uvicorn
from sse_starlette import EventSourceResponse
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route

from inkloop.report.page import page
from inkloop.report.page.feed import Feed

HOST = "127.0.0.1"
HOSTS = (HOST, "localhost")
"""Host names in a valid request; any other belongs to a site that resolves itself to this machine."""
LOOK_S = 0.25
"""Seconds between two looks at the files of the run."""
END_S, GRACE_S = 2, 1
"""Seconds for open connections and streams when the server ends."""
DIGITS = 9
"""Largest number of digits in a number of layers sent by a page."""


class Events:
    """Notifies all open pages of each change of a feed."""

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._changed = asyncio.Condition()

    async def look(self) -> None:
        """Read what has changed, and wake the streams."""
        await asyncio.to_thread(self._feed.refresh)
        async with self._changed:
            self._changed.notify_all()

    async def stream(self, ended: anyio.Event) -> AsyncIterator[dict[str, str]]:
        """An event now, and after each change, until the server ends; changes while one is sent are one event."""
        sent = -1
        while not ended.is_set():
            if self._feed.version == sent:
                async with self._changed:
                    await self._changed.wait()
            else:
                sent = self._feed.version
                yield {"data": str(sent)}


def application(feed: Feed) -> Starlette:
    """The application that serves the live page of a feed; it reads the files while it runs."""
    events = Events(feed)
    files = {"plotly.js": page.plotly(), **{name: page.own_file(name) for name in page.SCRIPTS}}

    async def root(_: Request) -> Response:
        policy = {"Content-Security-Policy": f"{page.POLICY}; {page.LIVE_SOURCES}; frame-ancestors 'none'"}
        return HTMLResponse(page.served(), headers=policy)

    async def script(request: Request) -> Response:
        return Response(files[request.url.path.strip("/")], media_type="text/javascript")

    def content(request: Request) -> Response:
        known = request.query_params.get("known", "")
        counts = [int(count) for count in known.split(",") if count.isdecimal() and len(count) < DIGITS]
        found = feed.content(request.query_params.get("epoch", ""), counts)
        return Response(page.as_json(found), media_type="application/json")

    async def stream(_: Request) -> Response:
        ended = anyio.Event()
        return EventSourceResponse(events.stream(ended), shutdown_event=ended, shutdown_grace_period=GRACE_S)

    @asynccontextmanager
    async def reading(_: Starlette) -> AsyncIterator[None]:
        async def look_again() -> None:
            while True:
                await events.look()
                await asyncio.sleep(LOOK_S)

        task = asyncio.create_task(look_again())
        yield
        task.cancel()

    routes: dict[str, Any] = {"/": root, "/content": content, "/events": stream}
    routes |= {f"/{name}": script for name in files}
    return Starlette(
        routes=[
            *(Route(path, answer, methods=["GET"]) for path, answer in routes.items()),
            Route("/favicon.ico", lambda _: PlainTextResponse("", status_code=204), methods=["GET"]),
        ],
        middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=list(HOSTS), www_redirect=False)],
        lifespan=reading,
    )


def server(feed: Feed) -> uvicorn.Server:
    """The server of a feed; `run` serves until Ctrl-C, on sockets that listen on this machine."""
    return uvicorn.Server(uvicorn.Config(application(feed), log_level="warning", timeout_graceful_shutdown=END_S))

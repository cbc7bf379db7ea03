"""A headless Chromium, driven by its DevTools protocol over a pipe: no library, no port, no driver of its own."""

from __future__ import annotations

import base64
import json
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
WORDS = (
    *("--headless=new", "--remote-debugging-pipe", "--no-sandbox", "--no-first-run", "--hide-scrollbars"),
    *("--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # WebGL without a graphics card
)
HINTS = ("willReadFrequently",)
"""Remarks of the browser on speed, which a page cannot avoid: Plotly draws the texts of 3D axes that way."""
needs_chromium = pytest.mark.skipif(
    not any(map(shutil.which, PROGRAMS)), reason="needs Chromium, which `make tools` installs"
)


class Browser:
    """One tab. `messages` are those of the console, errors of scripts and what the browser refused to load."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to = os.fdopen(to_browser, "wb", buffering=0)
        self._from = os.fdopen(from_browser, "rb")
        self._numbers = count(1)
        self._session = ""
        self.messages: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> Any:
        """The result of a call; what the browser reports before it is noted."""
        number = next(self._numbers)
        session = {"sessionId": self._session} if self._session else {}
        request = {"id": number, "method": method, "params": parameters, **session}
        self._to.write(json.dumps(request).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == number:
                assert "error" not in answer, answer["error"]
                return answer["result"]

    def open(self, url: str, *, width: int = 1400, height: int = 900) -> None:
        """Open a page, with the network off unless it is on this machine's loopback; waits for nothing."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        if url.startswith("file:"):
            off = {"offline": True, "latency": 0, "downloadThroughput": 0, "uploadThroughput": 0}
            self.call("Network.emulateNetworkConditions", **off)
        self.call("Page.navigate", url=url)

    def value(self, expression: str) -> Any:
        """The value of an expression in the page; a promise is awaited."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def wait(self, condition: str) -> None:
        """Wait until an expression in the page is true; it is looked at whenever the page draws."""
        look = f"const look = () => ({condition}) ? done() : setTimeout(look, 20); look();"
        self.value(f"new Promise((done) => {{ {look} }})")

    def click(self, x: float, y: float) -> None:
        """Move the mouse to a place of the window and click."""
        for kind in ("mouseMoved", "mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def picture(self, path: Path, *, whole: bool = False) -> None:
        """Write a PNG of the window, or of the whole page."""
        shot = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(shot["data"]))

    def close(self) -> None:
        """Close the pipe, which ends the browser."""
        self._to.close()
        self._from.close()

    def _read(self) -> dict[str, Any]:
        text = bytearray()
        while (byte := self._from.read(1)) != b"\0":
            assert byte, "Chromium has ended"
            text += byte
        message: dict[str, Any] = json.loads(text)
        self._note(message)
        return message

    def _note(self, message: dict[str, Any]) -> None:
        kind, details = message.get("method"), message.get("params", {})
        if kind == "Runtime.consoleAPICalled":
            words = " ".join(str(each.get("value", each.get("description", ""))) for each in details["args"])
            self.messages.append(f"console.{details['type']}: {words}")
        elif kind == "Runtime.exceptionThrown":
            self.messages.append(f"exception: {details['exceptionDetails']}")
        elif kind == "Log.entryAdded" and not any(hint in details["entry"]["text"] for hint in HINTS):
            self.messages.append(f"{details['entry']['level']}: {details['entry']['text']}")


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser with a profile of its own, ended with the block."""
    program = next(filter(None, map(shutil.which, PROGRAMS)))
    (their_in, our_out), (our_in, their_out) = os.pipe(), os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        words = [program, *WORDS, f"--user-data-dir={profile}"]
        process = subprocess.Popen(
            ["bash", "-c", f'exec "$@" 3<&{their_in} 4>&{their_out}', "bash", *words],
            pass_fds=(their_in, their_out),
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )
        os.close(their_in)
        os.close(their_out)
        tab = Browser(our_out, our_in)
        try:
            yield tab
        finally:
            tab.close()
            process.terminate()
            process.wait()

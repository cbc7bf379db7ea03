"""Other kinds of buses in front of the emulator: a server of socketcand, a group of UDP multicast."""

from __future__ import annotations

import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import can

from inkloop_hardware.bus.slcan_bus import BulkSlcanBus

GROUP = "239.74.163.2"
STAYS_HERE: dict[str, Any] = {"hop_limit": 0}
"""Frames do not leave this machine."""
POLL_S = 0.1


@contextmanager
def _forwarding(receive: Callable[[float], can.Message | None], send: Callable[[can.Message], None]) -> Iterator[None]:
    """A thread that sends each message that is received."""
    over = threading.Event()

    def forward() -> None:
        while not over.is_set():
            if (message := receive(POLL_S)) is not None:
                send(message)

    thread = threading.Thread(target=forward)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


@contextmanager
def multicast(channel: str, port: int) -> Iterator[None]:
    """The bench on GROUP. A sender to a group also receives what it sent: frames of the nodes are not sent back."""
    nodes = set[int]()
    with (
        BulkSlcanBus(channel, bitrate=500_000) as bench,
        can.Bus(GROUP, "udp_multicast", port=port, **STAYS_HERE) as group,
    ):

        def to_group(message: can.Message) -> None:
            nodes.add(message.arbitration_id)
            group.send(message)

        def to_bench(message: can.Message) -> None:
            if message.arbitration_id not in nodes:
                bench.send(message)

        with _forwarding(bench.recv, to_group), _forwarding(group.recv, to_bench):
            yield


class _RawMode(socketserver.StreamRequestHandler):
    """One client of socketcand, by doc/protocol.md of its source: opens a bus, then sends and receives all frames."""

    def handle(self) -> None:
        bench: can.BusABC = self.server.bench  # type: ignore[attr-defined]
        self._say("hi")
        for _ in ("open", "rawmode"):
            self._words()
            self._say("ok")
        with _forwarding(bench.recv, self._tell):
            while (words := self._words())[:1] == ["send"]:
                data = bytes(int(word, 16) for word in words[3:])
                assert len(data) == int(words[2], 16)
                bench.send(can.Message(arbitration_id=int(words[1], 16), data=data, is_extended_id=len(words[1]) > 3))

    def _tell(self, message: can.Message) -> None:
        digits = 8 if message.is_extended_id else 3
        self._say(f"frame {message.arbitration_id:0{digits}X} {message.timestamp:.6f} {message.data.hex().upper()}")

    def _say(self, words: str) -> None:
        with suppress(ConnectionError):  # the client has closed meanwhile
            self.wfile.write(f"< {words} >".encode())

    def _words(self) -> list[str]:
        """Those of the next command; none at the end of the connection."""
        found = bytearray()
        while (byte := self.rfile.read(1)) not in (b"", b">"):
            found += byte
        return found.decode().replace("<", " ").split()


@contextmanager
def socketcand(channel: str) -> Iterator[int]:
    """The bench behind a server; its port."""
    with BulkSlcanBus(channel, bitrate=500_000) as bench, socketserver.TCPServer(("127.0.0.1", 0), _RawMode) as server:
        server.bench = bench  # type: ignore[attr-defined]
        serving = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": POLL_S})
        serving.start()
        try:
            yield server.server_address[1]
        finally:
            server.shutdown()
            serving.join()

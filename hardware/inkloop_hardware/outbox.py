"""Messages to somebody who may not read: one thread writes, nobody waits."""

from __future__ import annotations

import threading
from io import RawIOBase

from inkloop_hardware.bus_messages import FRAME, Kind, write_message

ROOM = 8 << 20
"""Bytes that wait at most; the nodes' status of an hour and more."""
LAST_WAIT = 2.0
"""Seconds for the rest to leave at the end."""


class Outbox:
    """Keeps what was put and writes it in order; over ROOM, what may be dropped is. `dropped` counts its frames."""

    def __init__(self, stream: RawIOBase) -> None:
        self.dropped = 0
        self._stream = stream
        self._waiting: list[tuple[Kind, bytes]] = []
        self._bytes = 0
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    @property
    def is_writing(self) -> bool:
        """Whether what is put still goes anywhere."""
        return self._thread.is_alive()

    def put(self, kind: Kind, content: bytes, *, may_drop: bool = False) -> None:
        """Takes a message; returns at once."""
        with self._changed:
            if may_drop and self._bytes + len(content) > ROOM:
                self.dropped += len(content) // FRAME.size
                return
            self._waiting.append((kind, content))
            self._bytes += len(content)
            self._changed.notify()

    def close(self) -> None:
        """Gives the rest LAST_WAIT seconds to leave."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(LAST_WAIT)

    def _write(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._closed)
                messages, self._waiting, self._bytes = self._waiting, [], 0
                if not messages:
                    return
            try:
                for kind, content in messages:
                    write_message(self._stream, kind, content)
            except OSError:  # nobody reads any more; the end of stdin tells the process
                return

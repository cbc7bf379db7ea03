"""Start the bus process and exchange frames and commands with it."""

from __future__ import annotations

import io
import json
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Container, Iterable, Sequence
from contextlib import suppress
from queue import Empty, SimpleQueue
from struct import unpack

from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.messages import FRAMES_AT_ONCE, Kind, pack_frames, read_message, unpack_frames, write_message
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Frame

START_LIMIT = 120.0
"""Seconds for the process to start and open the adapter."""
END_LIMIT = 5.0
"""Seconds for it to end."""
SILENCE_LIMIT = 20.0
"""Seconds without a message of the bus process; it sends one every 50 ms."""
OTHERS_MAX = 100_000
"""Frames that wait at most, the newest ones: while a plan is computed none is taken."""


class BusConnection:
    """A running bus process.

    settings, session, job: see `BusSettings`, `Rig`; answer_ids: arbitration ids whose frames wait in a queue each
    (`receive`); all others, or those in kept_ids, wait in `others`. messages: log messages of the process. Every call
    raises BusError once the process, the adapter or the reading thread has failed, with its message.
    """

    is_live = True
    """Nodes and other masters may be on the bus."""
    now, sleep = staticmethod(time.monotonic), staticmethod(time.sleep)
    """The clock by which a user of the bus waits."""

    def __init__(
        self,
        settings: BusSettings,
        session: int,
        job: int,
        answer_ids: Iterable[int],
        kept_ids: Container[int] | None = None,
    ) -> None:
        self.settings = settings
        self.clock = 0.0
        """Second of the bus process's clock up to which all frames have been received."""
        self.others: deque[tuple[float, Frame]] = deque(maxlen=OTHERS_MAX)
        self._kept_ids = kept_ids
        self.messages: deque[str] = deque()
        self.priority = ""
        """The scheduling priority granted to the process, once it is open."""
        self.disconnected = ""
        """The reason why the adapter is disconnected, while it is being opened again; else empty."""
        self._queues: dict[int, SimpleQueue[bytes | None]] = {identifier: SimpleQueue() for identifier in answer_ids}
        self._failure: str | None = None
        self._heard = time.monotonic()
        self._opened = threading.Event()
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "inkloop_hardware.bus.process"],  # -P: ignore a can.py in this folder
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,  # a message leaves at once, and whole, even if Ctrl-C interrupts
            start_new_session=True,
        )
        assert isinstance(self._process.stdin, io.RawIOBase)
        assert isinstance(self._process.stdout, io.RawIOBase)
        self._commands: io.RawIOBase = self._process.stdin
        self._answers: io.BufferedIOBase = io.BufferedReader(self._process.stdout, 1 << 16)
        self._reader: threading.Thread = threading.Thread(target=self._read, name="inkloop bus reader", daemon=True)
        self._reader.start()
        arguments = {"settings": settings.to_json(), "session": session, "job": job}
        try:
            self._send(Kind.SETTINGS, json.dumps(arguments).encode())
            if not self._opened.wait(START_LIMIT):
                raise BusError(f"{settings} was not opened within {START_LIMIT:g} s")
            self.check()
        except BaseException:
            self.close()
            raise

    @property
    def process_id(self) -> int:
        """Of the bus process."""
        return self._process.pid

    def check(self) -> None:
        """BusError if frames are not exchanged any more."""
        if self._failure is not None:
            raise BusError(self._failure)
        silent = time.monotonic() - self._heard
        if self._opened.is_set() and silent > SILENCE_LIMIT:
            raise BusError(f"the bus process of {self.settings} has sent nothing for {silent:.0f} s")

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""
        for at in range(0, len(frames), FRAMES_AT_ONCE):
            self._send(Kind.FRAMES, pack_frames(frames[at : at + FRAMES_AT_ONCE]))

    def receive(self, identifier: int, wait_s: float) -> bytes | None:
        """Data of the next frame with this id, None if none comes within `wait_s`."""
        queue = self._queues[identifier]
        try:
            found = queue.get(timeout=wait_s) if wait_s > 0 else queue.get_nowait()
        except Empty:
            return None
        if found is None:  # the reader has ended
            queue.put(None)
            self.check()
        return found

    def send_keep_alive(self, enables: Enables) -> None:
        """Report that the control loop runs, and what it enables."""
        self._send(Kind.ALIVE, bytes([enables]))

    def send_job(self, job: int) -> None:
        """Change the job."""
        self._send(Kind.JOB, str(job).encode())

    def close(self) -> None:
        """End the process: enables drop, the log and the adapter are closed."""
        with suppress(OSError):  # it may have ended already
            write_message(self._commands, Kind.CLOSE)
        with suppress(OSError):
            self._commands.close()
        try:
            self._process.wait(END_LIMIT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join(END_LIMIT)
        self._answers.close()

    def _send(self, kind: Kind, content: bytes) -> None:
        self.check()
        try:
            write_message(self._commands, kind, content)
        except OSError as error:
            self._reader.join(END_LIMIT)  # reads its last message
            self.check()
            raise BusError(f"the bus process of {self.settings} takes no commands: {error}") from error

    def _read(self) -> None:
        """The only thread of this process that reads the bus; it only sorts frames."""
        failure = f"the bus process of {self.settings} ended without a message"
        try:
            failure = self._move() or failure
        except Exception as error:
            failure = f"the thread that reads {self.settings} failed: {type(error).__name__}: {error}"
        finally:
            self._failure = failure
            for queue in self._queues.values():
                queue.put(None)
            self._opened.set()

    def _move(self) -> str | None:
        """Sort messages of the process until its end; returns its last message if it failed."""
        failure = None
        while (message := read_message(self._answers)) is not None:
            kind, content = message
            self._heard = time.monotonic()
            if kind is Kind.FRAMES:
                self._sort(content)
            elif kind is Kind.CLOCK:
                self.clock = unpack("<d", content)[0]
            elif kind is Kind.MESSAGE:
                self.messages.append(content.decode())
            elif kind is Kind.DISCONNECTED:
                self.disconnected = content.decode()
            elif kind is Kind.OPENED:
                self.priority = content.decode()
                self._opened.set()
            elif kind is Kind.FAILED:
                failure = content.decode()
        return failure

    def _sort(self, content: bytes) -> None:
        for now, frame in unpack_frames(content):
            queue = self._queues.get(frame.arbitration_id)
            if queue is not None:
                queue.put(frame.data)
            elif self._kept_ids is None or frame.arbitration_id in self._kept_ids:
                self.others.append((now, frame))

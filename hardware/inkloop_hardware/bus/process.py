"""The process that owns the adapter: reads, writes, logs, and keeps the heartbeat while the control loop runs.

    python -m inkloop_hardware.bus.process

Started by `bus.connection`; its messages (`bus.messages`) arrive at stdin and leave at stdout. It never waits for its
parent: frames that the parent does not read are dropped and counted. It ends by a command, with its parent, and when
the adapter cannot be opened again; Ctrl-C in the terminal is left to the parent.
"""

from __future__ import annotations

import json
import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from io import BufferedIOBase, BufferedReader, FileIO
from struct import pack

import can

from inkloop_hardware.bus.adapter import PROOF, Adapter, Reopening, data_frame
from inkloop_hardware.bus.heartbeat import Enables, Heartbeat, raise_priority
from inkloop_hardware.bus.messages import Kind, Outbox, pack_frames, read_message, unpack_frames
from inkloop_hardware.bus.settings import BusSettings
from inkloop_hardware.bus.traffic_log import TrafficLog
from inkloop_hardware.errors import BusError, BusOff
from inkloop_hardware.protocol.codec import Codec, Frame

READ_WAIT, CLOCK_CYCLE = 0.02, 0.05
BEAT_WAIT = 0.01
"""Longest sleep of the heartbeat [s]: the delay until a silent loop is noticed."""


class BusProcess:
    """Serves one adapter with three threads: this one reads the bus, one takes commands, one keeps the heartbeat."""

    def __init__(self, settings: BusSettings, session: int, job: int, answers: Outbox) -> None:
        codec = Codec()
        self.answers = answers
        self.adapter = Adapter(settings)
        try:
            self.log = TrafficLog(settings.traffic_log) if settings.traffic_log else None
        except BusError:
            self.adapter.close()
            raise
        self.heartbeat = Heartbeat(codec, session, job, settings.grace_s, settings.loop_timeout_s)
        self.over = threading.Event()
        self.reopening = Reopening(settings.reopen_s)
        self._open = True
        self._trouble: BusError | None = None
        self._lit_until = 0.0
        self.failure: str | None = None
        self._sending = threading.RLock()
        self._logging = threading.Lock()
        self._complaints: dict[str, int] = {}

    def run(self, commands: BufferedIOBase) -> None:
        """Run until the command to end, the end of the parent, or a failure of the adapter."""
        for work in (lambda: self._take_commands(commands), self._beat):
            threading.Thread(target=self._guarded, args=(work,), daemon=True).start()
        self._guarded(self._read)
        with self._sending:
            if self.failure is None:
                self._guarded(lambda: self._send(self.heartbeat.end()))
            self._open = False
            self.adapter.close()
        with self._logging:
            if self.log:
                self.log.close()
        if self.failure:
            self.answers.put(Kind.FAILED, self.failure.encode())

    def _guarded(self, work: Callable[[], None]) -> None:
        """Run the work of a thread; the first failure of any ends all of them and becomes the message."""
        try:
            work()
        except BusError as error:
            self.failure = self.failure or str(error)
        except Exception as error:
            self.failure = self.failure or f"the bus process failed: {type(error).__name__}: {error}"
        finally:
            self.over.set()

    def _read(self) -> None:
        clock_due = 0.0
        while not self.over.is_set():
            try:
                messages = self.adapter.receive(READ_WAIT)
                if self._trouble:
                    raise self._trouble
            except BusError as error:
                self._reopen(error)
                continue
            now = time.monotonic()
            self._hand_on(messages, now)
            if now >= clock_due:
                clock_due = now + CLOCK_CYCLE
                self.answers.put(Kind.CLOCK, pack("<d", now), may_drop=True)
                self._complain()
                if self.log:
                    with self._logging:
                        self.log.flush(now)

    def _hand_on(self, messages: list[can.Message], now: float) -> None:
        if messages:
            self._log(messages)
            frames = [frame for message in messages if (frame := data_frame(message)) is not None]
            self.answers.put(Kind.FRAMES, pack_frames(frames, now), may_drop=True)

    def _reopen(self, error: BusError) -> None:
        """Open a disconnected adapter again. Enables have dropped, and the nodes de-energise themselves by then."""
        with self._sending:
            lit = isinstance(error, BusOff) and self._lit_until >= error.since
            self.heartbeat.end()
            self._open, self._trouble = False, None
            self.adapter.close()
        began = time.monotonic()
        self.answers.put(Kind.DISCONNECTED, f"{error} It is being opened again".encode())
        for pause in self.reopening.pauses(error, lit, began):
            if self._waited(pause):
                return
            if self._opened_again():
                break
        self.reopening.opened(time.monotonic())
        message = f"{self.adapter.settings}: connected again after {time.monotonic() - began:.1f} s, nothing is enabled"
        self.answers.put(Kind.MESSAGE, message.encode())
        self.answers.put(Kind.DISCONNECTED, b"")

    def _waited(self, pause: float) -> bool:
        """Wait; True if the process is to end meanwhile. The clock is still sent."""
        until = time.monotonic() + pause
        while not self.over.wait(min(CLOCK_CYCLE, max(0.0, until - time.monotonic()))):
            now = time.monotonic()
            self.answers.put(Kind.CLOCK, pack("<d", now), may_drop=True)
            if now >= until:
                return False
        return True

    def _opened_again(self) -> bool:
        try:
            adapter = Adapter(self.adapter.settings)
        except BusError:
            return False
        try:
            self._hand_on(adapter.receive(PROOF), time.monotonic())
        except BusError:
            adapter.close()
            return False
        with self._sending:
            self.adapter, self._open = adapter, True
        self._complaints = {}
        return True

    def _take_commands(self, commands: BufferedIOBase) -> None:
        while not self.over.is_set():
            message = read_message(commands)
            if message is None or message[0] is Kind.CLOSE:
                return
            kind, content = message
            now = time.monotonic()
            with self._sending:
                if kind is Kind.FRAMES:
                    self._send([frame for _, frame in unpack_frames(content)])
                elif kind is Kind.ALIVE and self._open:
                    self.heartbeat.keep_alive(now, Enables(content[0]))
                    self._note_lamp(now)
                elif kind is Kind.JOB:
                    self.heartbeat.change_job(now, int(content))
                self._send_due(now)

    def _note_lamp(self, now: float) -> None:
        if Enables.LAMP in self.heartbeat.enables:
            self._lit_until = math.inf
        elif self._lit_until == math.inf:
            self._lit_until = now

    def _beat(self) -> None:
        while not self.over.wait(BEAT_WAIT):
            with self._sending:
                now = time.monotonic()
                silent = self.heartbeat.silence(now)
                if silent is not None:
                    self._send(self.heartbeat.end())
                    message = f"the control loop was silent for {silent:.1f} s: the heartbeat ends, nothing is enabled"
                    self.answers.put(Kind.MESSAGE, message.encode())
                self._send_due(now)

    def _send_due(self, now: float) -> None:
        self._send(self.heartbeat.frames(now))

    def _send(self, frames: list[Frame]) -> None:
        try:
            if self._open and self._trouble is None:
                for frame in frames:
                    self._log([self.adapter.send(frame)])
        except BusError as error:
            self._trouble = error  # the reading thread opens the adapter again

    def _log(self, messages: list[can.Message]) -> None:
        if self.log:
            with self._logging:
                for message in messages:
                    self.log.take(message)

    def _complain(self) -> None:
        """Report each kind of problem: the first time, and whenever its count has doubled."""
        counts = self.adapter.complaints() | {"frames that the master did not read": self.answers.dropped}
        for what, count in counts.items():
            if count >= max(1, 2 * self._complaints.get(what, 0)):
                self.answers.put(Kind.MESSAGE, f"{self.adapter.settings}: {count} {what} so far".encode())
                self._complaints[what] = count


def main() -> int:
    """Serve the parent process; the exit code."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = Outbox(FileIO(os.dup(sys.stdout.fileno()), "w"))
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # the output of a driver must not mix with the messages
    commands = BufferedReader(FileIO(sys.stdin.fileno(), closefd=False))
    first = read_message(commands)
    if first is None or first[0] is not Kind.SETTINGS:
        return 2
    arguments = json.loads(first[1])
    priority = raise_priority()
    try:
        process = BusProcess(BusSettings.from_json(arguments.pop("settings")), **arguments, answers=answers)
    except BusError as error:
        answers.put(Kind.FAILED, str(error).encode())
        answers.close()
        return 1
    signal.signal(signal.SIGTERM, lambda *_: process.over.set())
    answers.put(Kind.OPENED, priority.encode())
    process.run(commands)
    answers.close()
    return 1 if process.failure else 0


if __name__ == "__main__":
    status = main()
    os._exit(status)  # a thread may still wait at stdin

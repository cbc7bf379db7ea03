"""The bus of a mapped rig: frames by its DBC and services of its peers; other frames are ignored."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from inkloop_hardware.bus.fmu_connection import connected
from inkloop_hardware.bus.heartbeat import Enables
from inkloop_hardware.bus.settings import BusSettings, lock_channel
from inkloop_hardware.errors import FrameError, HardwareError, LinkTimeout
from inkloop_hardware.mapped.mapped_peer import Peer
from inkloop_hardware.mapped.mapping_file import RigMapping
from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame, Reading, id_of


class Readings:
    """newest: of each message; counts: of its frames, dropped ones included."""

    def __init__(self, codec: Codec) -> None:
        self.newest: dict[str, Reading] = {}
        self.counts = Counter[str]()
        self._codec = codec
        self._names = {id_of(message): message.name for message in codec.database.messages}
        self._dropped: dict[str, str] = {}

    def take(self, frame: Frame) -> Reading | None:
        """The content of a frame; None for one that is dropped, or not in the DBC."""
        name = self._names.get(frame.arbitration_id)
        if name is None:
            return None
        self.counts[name] += 1
        try:
            reading = self._codec.decode(frame, strict=False)
        except FrameError as error:  # too short, or a container
            self._dropped[name] = str(error)
            return None
        if not reading.intact:
            self._dropped[name] = f"the check byte of {frame} is wrong; has it another data id?"
            return None
        self.newest[name] = reading
        return reading

    def found(self, message: str, signal: str) -> str:
        """The last value of a signal in words, or why there is none."""
        last = self.newest.get(message)
        if last is None:
            reason = self._dropped.get(message)
            return f"its frames were dropped: {reason}" if reason else "no frame of it was received"
        if signal in last.dropped:
            return f"its value was dropped: {last.dropped[signal]}"
        value = last.values.get(signal, float("nan"))
        return f"it is {self._codec.choice(message, signal, value) or f'{value:g}'}"


KEEP_ALIVE_PERIOD_S = 0.02
PAUSE = 0.005
KEPT = 4096
"""Frames of one message that wait at most."""


class MappedBus:
    """An open bus; `readings` holds the newest of each message, `inbox` those since `forget`, oldest first.

    is_alone: no other print of this machine may use its channel.
    """

    def __init__(
        self,
        settings: BusSettings,
        folder: Path | None,
        mapping: RigMapping,
        session: int,
        job: int,
        *,
        is_alone: bool = True,
    ) -> None:
        log = settings.traffic_log
        if log is not None and folder is not None:
            log = folder / log
        self.inbox: dict[str, deque[Reading]] = {}
        self._codec, self._heartbeat = mapping.codec, mapping.tables.heartbeat
        self._received = Readings(mapping.codec)
        self.readings = self._received.newest
        self._counters: dict[str, int] = {}
        self._enables = Enables.NONE
        self._keep_alive_due = 0.0
        answers = [answer for _, answer in mapping.ids.values()]
        own = replace(settings, traffic_log=log, fd=settings.fd or mapping.needs_fd)
        self._release = lock_channel(settings) if is_alone else lambda: None
        try:
            self._bus = connected(own, session, job, answers)
        except BaseException:
            self._release()
            raise
        self.now, self.sleep = self._bus.now, self._bus.sleep
        self._peers = {
            name: Peer(name, _Wire(self, answer), request, answer, peer.answer_s, fd=peer.fd)
            for name, (request, answer) in mapping.ids.items()
            for peer in (mapping.tables.peers[name],)
        }

    def peer(self, name: str) -> Peer:
        """The peer with this name."""
        return self._peers[name]

    def send(self, message: str, values: Mapping[str, float | str]) -> None:
        """Send one frame, with the next counter if the message is supervised."""
        counter = None
        if self._codec.data_id(message) is not None:
            counter = self._counters[message] = (self._counters.get(message, -1) + 1) % COUNTERS
        self.send_frames([self._codec.encode(message, values, counter)])

    def send_frames(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""
        self._bus.send(frames)

    def take(self) -> None:
        """Keep the heartbeat alive, if the mapping has one, and read the received frames. BusError if it failed."""
        self._bus.check()
        now = self.now()
        if self._heartbeat and now >= self._keep_alive_due:
            self._keep_alive_due = now + KEEP_ALIVE_PERIOD_S
            self._bus.send_keep_alive(self._enables)
        while self._bus.others:
            _, frame = self._bus.others.popleft()
            if (reading := self._received.take(frame)) is not None:
                self.inbox.setdefault(reading.message, deque(maxlen=KEPT)).append(reading)

    def forget(self) -> None:
        """Discard the frames received so far."""
        self.take()
        self.inbox.clear()

    def wait(
        self, message: str, signal: str, expected: float | str, limit_s: float, unless: float | str | None = None
    ) -> None:
        """Wait until a frame of the inbox has the expected value; earlier frames of its message are discarded.

        LinkTimeout with the last value, HardwareError at once when a frame has the value `unless`.
        """
        until = self.now() + limit_s
        while True:
            self.take()
            waiting = self.inbox.get(message, deque())
            while waiting:
                reading = waiting.popleft()
                if self._has(reading, signal, expected):
                    return
                if unless is not None and self._has(reading, signal, unless):
                    raise HardwareError(f"{message}.{signal} is {unless}, expected {expected}; check the rig")
            if self.now() > until:
                found = self._received.found(message, signal)
                raise LinkTimeout(f"{message}.{signal} was not {expected} within {limit_s:g} s; {found}")
            self.sleep(PAUSE)

    @contextmanager
    def enabled(self, names: Sequence[str]) -> Iterator[None]:
        """Enable outputs for one step; nothing is enabled after it, even after an error."""
        if not names:
            yield
            return
        try:
            self._enables = Enables(sum(Enables[name.upper()] for name in names))
            self._bus.send_keep_alive(self._enables)
            yield
        finally:
            self._enables = Enables.NONE
            self._bus.send_keep_alive(self._enables)

    def close(self) -> None:
        """Release the adapter and its channel."""
        try:
            self._bus.close()
        finally:
            self._release()

    def receive(self, identifier: int, wait_s: float) -> bytes | None:
        """Data of the next frame of a peer."""
        return self._bus.receive(identifier, wait_s)

    def _has(self, reading: Reading, signal: str, expected: float | str) -> bool:
        if signal not in reading.values:
            return False
        if isinstance(expected, str):
            return self._codec.choice(reading.message, signal, reading.values[signal]) == expected
        return abs(reading.values[signal] - expected) <= 1e-9 * max(1.0, abs(expected))


class _Wire:
    """The way to one peer over the bus."""

    def __init__(self, bus: MappedBus, answer: int) -> None:
        self._bus, self._answer = bus, answer

    def send(self, frames: Sequence[Frame]) -> None:
        self._bus.send_frames(frames)

    def receive(self, wait_s: float) -> bytes | None:
        return self._bus.receive(self._answer, wait_s)

    def now(self) -> float:
        return self._bus.now()

    def begin(self) -> None:
        self._bus.take()

    def check(self) -> None:
        self._bus.take()

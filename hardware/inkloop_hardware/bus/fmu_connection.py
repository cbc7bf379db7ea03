"""A bus connection on simulated time: the bench is an FMU, and steps while the control loop waits for it.

It replaces `BusConnection` for the interface `inkloop_fmu`. Devices, links and heartbeat are those of a bench. A plan
takes no time, nothing depends on the load of the machine, and two runs exchange the same frames at the same times.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Container, Iterable, Sequence

from inkloop.units import S_PER_NS
from inkloop_hardware.bus.adapter import Adapter, data_frame
from inkloop_hardware.bus.connection import OTHERS_MAX, BusConnection
from inkloop_hardware.bus.fmu_bus import INTERFACE, STEP_NS
from inkloop_hardware.bus.heartbeat import Enables, Heartbeat
from inkloop_hardware.bus.settings import BusSettings, interface_of
from inkloop_hardware.bus.traffic_log import TrafficLog
from inkloop_hardware.errors import BusError
from inkloop_hardware.protocol.codec import Codec, Frame

STEP_S = STEP_NS * S_PER_NS
REPLY_S = 1e-6
"""Seconds between what came and what is sent then, in the log."""


class FmuConnection:
    """The interface of `BusConnection` on an FMU in this process. Time passes in `receive` and `sleep` alone."""

    is_live = True
    priority = "the time of the FMU"
    disconnected = ""

    def __init__(
        self,
        settings: BusSettings,
        session: int,
        job: int,
        answer_ids: Iterable[int],
        kept_ids: Container[int] | None = None,
    ) -> None:
        self.settings = settings
        self.others: deque[tuple[float, Frame]] = deque(maxlen=OTHERS_MAX)
        self.messages: deque[str] = deque()
        self._kept_ids = kept_ids
        self._queues: dict[int, deque[bytes]] = {identifier: deque() for identifier in answer_ids}
        self._heartbeat = Heartbeat(Codec(), session, job, settings.grace_s, settings.loop_timeout_s)
        self._adapter = Adapter(settings)
        self.now = self._adapter.now
        try:
            self._log = TrafficLog(settings.traffic_log, lambda second: second) if settings.traffic_log else None
        except BusError:
            self._adapter.close()
            raise

    @property
    def clock(self) -> float:
        """Second up to which all frames have been received."""
        return self.now()

    def check(self) -> None:
        """An FMU fails where it steps."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""
        for frame in frames:
            message = self._adapter.send(frame)
            message.timestamp += REPLY_S
            if self._log:
                self._log.take(message)

    def receive(self, identifier: int, wait_s: float) -> bytes | None:
        """Data of the next frame with this id, None if none comes within `wait_s`."""
        queue, until = self._queues[identifier], self.now() + wait_s
        while not queue and self.now() < until:
            self._step()
        return queue.popleft() if queue else None

    def sleep(self, seconds: float) -> None:
        """Let time pass."""
        until = self.now() + seconds
        while self.now() < until:
            self._step()

    def send_keep_alive(self, enables: Enables) -> None:
        """Report that the control loop runs, and what it enables."""
        self._heartbeat.keep_alive(self.now(), enables)
        self._beat()

    def send_job(self, job: int) -> None:
        """Change the job."""
        self._heartbeat.change_job(self.now(), job)
        self._beat()

    def close(self) -> None:
        """Send the last heartbeat, end log and FMU."""
        self.send(self._heartbeat.end())
        self._adapter.close()
        if self._log:
            self._log.close()

    def _beat(self) -> None:
        self.send(self._heartbeat.frames(self.now()))

    def _step(self) -> None:
        self._beat()
        for message in self._adapter.receive(STEP_S):
            if self._log:
                self._log.take(message)
            frame = data_frame(message)
            if frame is None:
                continue
            if frame.arbitration_id in self._queues:
                self._queues[frame.arbitration_id].append(frame.data)
            elif self._kept_ids is None or frame.arbitration_id in self._kept_ids:
                self.others.append((self.now(), frame))
        if self._log:
            self._log.flush(self.now())


def connected(
    settings: BusSettings, session: int, job: int, answer_ids: Iterable[int], kept_ids: Container[int] | None = None
) -> BusConnection | FmuConnection:
    """A bus process, or an FMU if that is the interface. BusError."""
    kind = FmuConnection if interface_of(settings) == INTERFACE else BusConnection
    return kind(settings, session, job, answer_ids, kept_ids)

"""A bench as an FMU on a CAN bus (FMI-LS-BUS), as an interface of python-can: `inkloop_fmu`, channel: the file.

The FMU steps in this process while somebody receives or sleeps. Each opening is a bench that has just been switched on.
"""

from __future__ import annotations

import importlib
import time
from collections import deque
from typing import Any

import can

from inkloop.errors import InkloopError
from inkloop.units import NS_PER_S, S_PER_NS

INTERFACE = "inkloop_fmu"
STEP_NS = 1_000_000
"""Step of the FMU: it takes and gives frames at its ends."""
LATE_NS = 200_000_000
"""Time that the FMU makes up for after the machine was busy; what is beyond did not pass for it."""


class FmuBus(can.BusABC):
    """The bus of the one bus terminal of an FMU. Raises CanInitializationError, later CanOperationError.

    parameters: of the FMU, by name; real_time: its time is that of the clock, as other programs expect; else it passes
    in `recv` and `sleep` alone, which do not wait.
    """

    def __init__(
        self, channel: str, *, parameters: dict[str, Any] | None = None, real_time: bool = True, **options: Any
    ) -> None:
        options.pop("bitrate", None)
        super().__init__(channel, **options)
        self._outgoing: deque[tuple[int, bytes, bool, bool]] = deque()
        self._incoming: deque[can.Message] = deque()
        try:
            self._node = importlib.import_module("inkloop.fmu.bus").BusNode(channel, parameters or {})
        except InkloopError as error:
            self._is_shutdown = True  # keeps its destructor from complaining
            raise can.CanInitializationError(str(error)) from error
        self._now_ns = 0
        self._begin_ns = time.monotonic_ns() if real_time else None
        self._origin = time.time() if real_time else 0.0
        self.channel_info = f"FMU {channel}"

    def now(self) -> float:
        """Second of the time of the FMU, which begins with 0, in real time with that of the clock."""
        return self._origin + self._now_ns * S_PER_NS

    def sleep(self, seconds: float) -> None:
        """Let time pass; frames that come meanwhile are received later."""
        until = self._present_ns() + seconds * NS_PER_S
        while self._now_ns < until:
            self._step()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give a frame to the FMU at the end of its present step; CanOperationError for one of CAN FD."""
        if msg.is_fd:
            raise can.CanOperationError("the bus of the FMU is classic CAN; set bench.fd = false")
        self._outgoing.append((msg.arbitration_id, bytes(msg.data), msg.is_extended_id, msg.is_remote_frame))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame that the filters let through, None if none comes within `timeout` s of the time of the FMU."""
        until = None if timeout is None else self._present_ns() + timeout * NS_PER_S
        while True:
            while self._incoming:
                message = self._incoming.popleft()
                if self._matches_filters(message):
                    return message
            if until is not None and self._now_ns >= until:
                return None
            self._step()

    def _present_ns(self) -> int:
        """The time to which the FMU is brought before any wait."""
        if self._begin_ns is None:
            return self._now_ns
        present = time.monotonic_ns() - self._begin_ns
        late = max(0, present - self._now_ns - LATE_NS)
        self._begin_ns += late
        return present - late

    def _step(self) -> None:
        given = [self._outgoing.popleft() for _ in range(len(self._outgoing))]
        try:
            frames = self._node.step(self._now_ns, STEP_NS, given)
        except InkloopError as error:
            raise can.CanOperationError(str(error)) from error
        self._now_ns += STEP_NS
        self._incoming.extend(
            can.Message(self.now(), frame.identifier, frame.is_extended, frame.is_remote, data=frame.data)
            for frame in frames
        )
        if self._begin_ns is not None:
            time.sleep(max(0, self._now_ns - self._present_ns()) * S_PER_NS)

    def shutdown(self) -> None:
        """End the FMU."""
        super().shutdown()
        self._node.close()

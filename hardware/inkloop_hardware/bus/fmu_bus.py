"""A bench as an FMU on a CAN bus (FMI-LS-BUS), as an interface of python-can: `inkloop_fmu`, channel: the file.

The FMU runs in real time in this process: whoever reads brings it to the present, in steps of at most STEP_NS. Each
opening is a bench that has just been switched on.
"""

from __future__ import annotations

import importlib
import threading
import time
from collections import deque
from typing import Any

import can

STEP_NS = 1_000_000
"""Step of the FMU: it takes and gives frames at its ends."""
PAUSE_S = 0.0005
"""Between two looks while nothing comes."""
LATE_NS = 200_000_000
"""Time that the FMU makes up for after the machine was busy; what is beyond did not pass for it."""


class FmuBus(can.BusABC):
    """The bus of the one bus terminal of an FMU. parameters: of the FMU, by name. Raises CanInitializationError."""

    def __init__(self, channel: str, *, parameters: dict[str, Any] | None = None, **options: Any) -> None:
        options.pop("bitrate", None)
        super().__init__(channel, **options)
        self._lock = threading.Lock()
        self._outgoing: list[Any] = []
        self._incoming: deque[can.Message] = deque()
        try:
            self._node = importlib.import_module("inkloop.fmu.bus").BusNode(channel, parameters or {})
        except Exception as error:
            self._is_shutdown = True  # keeps its destructor from complaining
            raise can.CanInitializationError(str(error)) from error
        self._now_ns = 0
        self._begin_ns = time.monotonic_ns()
        self.channel_info = f"FMU {channel}"

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give a frame to the FMU at the end of its present step; CanOperationError for one of CAN FD."""
        if msg.is_fd:
            raise can.CanOperationError("the bus of the FMU is classic CAN; set bench.fd = false")
        with self._lock:
            self._outgoing.append((msg.arbitration_id, bytes(msg.data), msg.is_extended_id, msg.is_remote_frame))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        until = None if timeout is None else time.monotonic() + timeout
        while True:
            with self._lock:
                if not self._incoming:
                    self._follow()
                if self._incoming:
                    return self._incoming.popleft(), False
            if until is not None and time.monotonic() >= until:
                return None, False
            time.sleep(PAUSE_S)

    def _follow(self) -> None:
        """Bring the FMU to the present."""
        present_ns = time.monotonic_ns() - self._begin_ns
        if present_ns - self._now_ns > LATE_NS:
            self._begin_ns += present_ns - self._now_ns - LATE_NS
            present_ns = self._now_ns + LATE_NS
        while self._now_ns + STEP_NS <= present_ns and not self._incoming:
            outgoing, self._outgoing = self._outgoing, []
            try:
                frames = self._node.step(self._now_ns, STEP_NS, outgoing)
            except Exception as error:
                raise can.CanOperationError(str(error)) from error
            self._now_ns += STEP_NS
            self._incoming.extend(_message(*frame) for frame in frames)

    def shutdown(self) -> None:
        """End the FMU."""
        super().shutdown()
        with self._lock:
            self._node.close()


def _message(identifier: int, data: bytes, is_extended: bool, is_remote: bool) -> can.Message:
    return can.Message(time.time(), identifier, is_extended, is_remote, data=None if is_remote else data)

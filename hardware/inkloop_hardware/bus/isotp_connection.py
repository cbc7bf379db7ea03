"""ISO-TP to one node, as the connection of a udsoncan client.

can-isotp implements the protocol; every send and wait here drives it, without threads, so no error is lost. Its own
timeouts are disabled: a wait ends after the caller's time without progress, by the clock of the wire.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Protocol

import isotp
from udsoncan.connections import BaseConnection
from udsoncan.exceptions import TimeoutException

from inkloop_hardware.protocol.codec import EXTENDED, FD_LENGTHS, Frame, id_text

SLICE = 0.05
"""Seconds between two checks of the wire during a wait."""
FLOW_TIMEOUT = 1.0
"""Seconds for the flow control of the node in a long message (N_Bs of ISO 15765-2)."""
ANSWER_LIMIT = 30.0
"""Seconds for an answer without a deadline, however often the node answers "still busy"."""
TORN_QUIET, MESSAGE_QUIET = 0.05, 0.25
"""Seconds without a frame after which a message is abandoned that lost one, or that stopped midway: both are requested
again sooner than after N_Cr of ISO 15765-2 (1 s)."""
PADDING = 0xCC
GIVE_UP = bytes((0x32, 0, 0, *5 * (PADDING,)))
"""Flow control "overflow": the node stops sending and can be asked again."""
FLOW_CONTROL, LONGEST_MS = 0x3, 0x7F
SHORT_GAPS = range(0xF1, 0xFA)
"""STmin of 100 to 900 microseconds; the values between these and 127 ms are reserved."""
NEVER_MS = 3_600_000
PARAMETERS = {
    "tx_padding": PADDING,
    "blocksize": 64,
    "stmin": 0,
    "wftmax": 8,
    "max_frame_size": 4095,
    "logger_name": "inkloop_isotp",
    "rx_flowcontrol_timeout": NEVER_MS,
    "rx_consecutive_frame_timeout": NEVER_MS,
}


class Wire(Protocol):
    """Access to one node over a bus."""

    def begin(self) -> None:
        """Begin a request."""

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames in this order."""

    def receive(self, wait_s: float) -> bytes | None:
        """Data of the next ISO-TP frame of the node, None if none comes within `wait_s`."""

    def now(self) -> float:
        """Seconds of a clock that only goes forward."""

    def check(self) -> None:
        """Report that the control loop runs; raises the error that makes waiting useless."""


class IsoTpConnection(BaseConnection):
    """Messages to and from one node.

    wire: the way to it; request_id, answer_id: arbitration ids as in `Frame`, both of the same length; fd: requests go
    in CAN FD frames of up to 64 bytes; is_answer: whether a message answers the last request, any other is dropped and
    counted (`stray`); quiet_s: seconds without a frame after which a message that stopped midway is given up. `broken`
    counts errors of ISO-TP: lost, doubled and swapped frames, messages that stopped midway. `deadline`: no wait lasts
    beyond this second of the wire's clock.
    """

    def __init__(
        self,
        wire: Wire,
        request_id: int,
        answer_id: int,
        is_answer: Callable[[bytes, bytes], bool],
        *,
        fd: bool = False,
        quiet_s: float = MESSAGE_QUIET,
    ) -> None:
        super().__init__(id_text(request_id))
        self.stray = 0
        self.broken = 0
        self.deadline: float | None = None
        self._wire = wire
        self._is_answer = is_answer
        self._request_id, self._answer_id, self._fd = request_id, answer_id, fd
        self._quiet_s = quiet_s
        self._torn = False
        self._request = b""
        self._unsent: list[Frame] = []
        self._moved = 0.0
        self._asked = 0.0
        self._checked = 0.0
        self._extended = bool(request_id & EXTENDED)
        mode = isotp.AddressingMode.Normal_29bits if self._extended else isotp.AddressingMode.Normal_11bits
        address = isotp.Address(mode, txid=request_id & ~EXTENDED, rxid=answer_id & ~EXTENDED)
        parameters = PARAMETERS | ({"can_fd": True, "tx_data_length": FD_LENGTHS[-1]} if fd else {})
        self._stack = isotp.TransportLayerLogic(self._take, self._give, address, self._count, parameters)
        self._stack.logger.setLevel(logging.CRITICAL)  # its warnings, thousands where one frame is lost, are counted

    def open(self) -> IsoTpConnection:
        """Nothing to open: the wire is open."""
        return self

    def close(self) -> None:
        """Nothing to close."""

    def __exit__(self, *_: object) -> None:
        self.close()

    def is_open(self) -> bool:
        """Always."""
        return True

    def empty_rxqueue(self) -> None:
        """Begin a request: discard late and unfinished messages."""
        self._wire.begin()
        while self._wire.receive(0.0) is not None:
            self.stray += 1
        while self._stack.recv() is not None:  # arrived directly after the last answer
            self.stray += 1
        self._stack.reset()
        self._torn = False
        self._unsent.clear()

    def specific_send(self, payload: bytes, timeout: float | None = None) -> None:
        """Send a whole message; TimeoutException if the flow control of the node does not come."""
        self._request = bytes(payload)
        self._moved = self._asked = self._wire.now()
        self._stack.send(payload)
        while self._stack.transmitting():
            self._turn(FLOW_TIMEOUT if timeout is None else timeout)

    def specific_wait_frame(self, timeout: float | None = None) -> bytes:
        """The answer to the last request; TimeoutException when nothing came for `timeout` s."""
        self._moved = self._wire.now()
        while True:
            while (message := self._stack.recv()) is not None:
                self._torn = False
                if self._is_answer(self._request, bytes(message)):
                    return bytes(message)
                self.stray += 1
            self._turn(FLOW_TIMEOUT if timeout is None else timeout)

    def pause(self, seconds: float) -> None:
        """Wait without a request, with the checks of the wire."""
        until = self._wire.now() + seconds
        while (left := until - self._wire.now()) > 0:
            self.stray += self._wire.receive(min(left, SLICE)) is not None
            self._wire.check()

    def _turn(self, timeout: float) -> None:
        """Drive the protocol until it has waited for one slice."""
        self._stack.process(SLICE)
        self._flush()
        now = self._wire.now()
        if self._torn or self._stack.is_rx_active():
            self._give_up_a_broken_message(now - self._moved)
        limit = self._asked + ANSWER_LIMIT if self.deadline is None else self.deadline
        if now - self._moved > timeout or now > limit:
            raise TimeoutException(f"no frame for {timeout:g} s")  # type: ignore[no-untyped-call]

    def _give_up_a_broken_message(self, quiet: float) -> None:
        if quiet <= (TORN_QUIET if self._torn else self._quiet_s):
            return
        self.broken += not self._torn  # a lost frame is counted already
        self._torn = False
        self._stack.reset()
        self._wire.send([Frame(self._request_id, GIVE_UP, self._fd)])
        raise TimeoutException("a message lost a frame")  # type: ignore[no-untyped-call]

    def _take(self, wait_s: float) -> isotp.CanMessage | None:
        """The next frame for the protocol; waits only if there is nothing else to do."""
        self._flush()
        data = self._wire.receive(0.0 if self._stack.available() else wait_s)
        now = self._wire.now()
        if data is None or now - self._checked > SLICE:
            self._checked = now
            self._wire.check()
        if data is None:
            return None
        self._moved = now
        data = without_reserved_gap(data)
        return isotp.CanMessage(
            arbitration_id=self._answer_id & ~EXTENDED, dlc=len(data), data=data, extended_id=self._extended
        )

    def _give(self, message: isotp.CanMessage) -> None:
        self._unsent.append(Frame(self._request_id, bytes(message.data), self._fd))

    def _flush(self) -> None:
        if self._unsent:
            frames, self._unsent = self._unsent, []
            self._wire.send(frames)
            self._moved = self._wire.now()

    def _count(self, error: Exception) -> None:
        self.broken += 1
        self._torn = self._torn or isinstance(error, isotp.WrongSequenceNumberError)


def without_reserved_gap(data: bytes) -> bytes:
    """A frame, of a flow control with a reserved STmin that of 127 ms (ISO 15765-2, 9.6.5.4)."""
    if len(data) < 3 or data[0] >> 4 != FLOW_CONTROL or data[2] <= LONGEST_MS or data[2] in SHORT_GAPS:
        return data
    return data[:2] + bytes([LONGEST_MS]) + data[3:]

"""When the master says that it lives, and what it enables.

The bus process sends MasterAlive only while the control loop says that it is alive: a loop that hangs must not look
alive. Nothing here knows a bus or a clock; seconds come in, frames go out.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, StopRequest, pack
from inkloop_hardware.protocol.vocabulary import Source

AGAIN = 0.02
"""Seconds after a change of enables it is said a second time, so that one lost frame changes nothing."""
LAST_STOPS = 3
"""So often it is said that a stop request is over."""


class Enables(IntFlag):
    """What the present step may do."""

    NONE = 0
    LAMP = 1
    GATE = 2
    MOTION = 4


@dataclass
class Heartbeat:
    """MasterAlive, gated by the words of the control loop.

    session, job: as in MasterAlive; grace, loop_timeout: seconds without a word, with and without anything enabled.
    After a silence with something enabled, nothing can be enabled before the loop has said that it enables nothing.
    """

    codec: Codec
    session: int
    job: int
    grace: float
    loop_timeout: float
    beating: bool = False
    enables: Enables = Enables.NONE
    lapsed: bool = False
    _said: Enables | None = None
    _word: float = 0.0
    _due: float = 0.0

    def __post_init__(self) -> None:
        self._sender = Supervised(self.codec)
        self._cycle = self.codec.cycle_time(MasterAlive.message) or 0.1

    def word(self, now: float, enables: Enables) -> None:
        """The control loop is alive and wants these enables; what changes is due at once."""
        self._word = now
        self.lapsed = self.lapsed and bool(enables)
        wanted = Enables.NONE if self.lapsed else enables
        if wanted != self.enables or not self.beating:
            self._due = now
        self.beating = True
        self.enables = wanted

    def change_job(self, now: float, job: int) -> None:
        """Another job; said at once and twice, so that no request for it comes before the nodes know it."""
        self.job = job
        self._said = None
        if self.beating:
            self._due = now

    def frames(self, now: float) -> list[Frame]:
        """What is to be sent now."""
        if not self.beating or now < self._due:
            return []
        self._due = after(self._due, self._cycle if self._said == self.enables else AGAIN, now)
        return [self._frame()]

    def silence(self, now: float) -> float | None:
        """Seconds without a word if that is too long, and `end` is to be called; else None."""
        silent = now - self._word
        if not self.beating or silent <= (self.grace if self.enables else self.loop_timeout):
            return None
        return silent

    def end(self) -> list[Frame]:
        """The last frame, which drops what was enabled; then silence, until the next word."""
        if not self.beating:
            return []
        self.lapsed = bool(self.enables)
        self.beating, self.enables = False, Enables.NONE
        return [self._frame()]

    def _frame(self) -> Frame:
        self._said = self.enables
        lamp, gate, motion = (one in self.enables for one in (Enables.LAMP, Enables.GATE, Enables.MOTION))
        return self._sender.frame(MasterAlive(lamp, gate, motion, self.session, self.job))


@dataclass
class StopCall:
    """StopRequest: repeated while it is active, and a few times after it is not any more."""

    codec: Codec
    active: bool = False
    _left: int = 0
    _due: float = 0.0

    def __post_init__(self) -> None:
        self._sender = Supervised(self.codec)
        self._cycle = self.codec.cycle_time(StopRequest.message) or 0.05

    def set(self, now: float, active: bool) -> None:
        """Begins or ends the request; due at once."""
        if self.active and not active:
            self._left = LAST_STOPS
        self.active, self._due = active, now

    def frames(self, now: float) -> list[Frame]:
        """What is to be sent now."""
        if now < self._due or not (self.active or self._left):
            return []
        self._left = max(0, self._left - 1)
        self._due = after(self._due, self._cycle, now)
        return [self._sender.frame(StopRequest(self.active, Source.MASTER))]


def after(due: float, cycle: float, now: float) -> float:
    """When the next one is due: without drift, but never a burst of what was missed."""
    return due + cycle if due + cycle > now else now + cycle


@dataclass
class Supervised:
    """Frames of one supervised message, each with the next counter."""

    codec: Codec
    counter: int = 0

    def frame(self, record: MasterAlive | StopRequest) -> Frame:
        """The next frame."""
        frame = pack(self.codec, record, self.counter)
        self.counter = (self.counter + 1) % COUNTERS
        return frame

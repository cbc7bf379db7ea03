"""Schedule of the heartbeat, MasterAlive with its enables, and the priority of the process that sends it.

The bus process sends MasterAlive only while the control loop reports that it runs: a loop that hangs must not look
alive. No bus and no clock here: seconds come in, frames go out.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from enum import IntFlag

from inkloop_hardware.protocol.codec import COUNTERS, Codec, Frame
from inkloop_hardware.protocol.records import MasterAlive, StopRequest, pack

AGAIN = 0.02
"""Seconds after which a change of enables is sent a second time, so that one lost frame changes nothing."""


class Enables(IntFlag):
    """Outputs that the present step may energise."""

    NONE = 0
    LAMP = 1
    GATE = 2
    MOTION = 4


@dataclass
class Heartbeat:
    """MasterAlive, sent as long as the control loop keeps it alive.

    session, job: as in MasterAlive; grace, loop_timeout: seconds that the loop may be silent, with and without anything
    enabled. After too long a silence with something enabled, the loop must first enable nothing, then it may enable
    again.
    """

    codec: Codec
    session: int
    job: int
    grace: float
    loop_timeout: float
    beating: bool = False
    enables: Enables = Enables.NONE
    lapsed: bool = False
    _sent: Enables | None = None
    _kept_alive: float = 0.0
    _due: float = 0.0

    def __post_init__(self) -> None:
        self._sender = Supervised(self.codec)
        self._cycle = self.codec.cycle_time(MasterAlive.message) or 0.1

    def keep_alive(self, now: float, enables: Enables) -> None:
        """Take a report of the control loop, with the enables it wants; a change is due at once."""
        self._kept_alive = now
        self.lapsed = self.lapsed and bool(enables)
        wanted = Enables.NONE if self.lapsed else enables
        if wanted != self.enables or not self.beating:
            self._due = now
        self.beating = True
        self.enables = wanted

    def change_job(self, now: float, job: int) -> None:
        """Change the job; sent at once and twice, so that no request for it comes before the nodes know it."""
        self.job = job
        self._sent = None
        if self.beating:
            self._due = now

    def frames(self, now: float) -> list[Frame]:
        """Frames that are due now."""
        if not self.beating or now < self._due:
            return []
        self._due = after(self._due, self._cycle if self._sent == self.enables else AGAIN, now)
        return [self._frame()]

    def silence(self, now: float) -> float | None:
        """Seconds that the loop has been silent, if that is too long and `end` is to be called; else None."""
        silent = now - self._kept_alive
        if not self.beating or silent <= (self.grace if self.enables else self.loop_timeout):
            return None
        return silent

    def end(self) -> list[Frame]:
        """The last frame, which drops the enables; then silence, until the loop reports again."""
        if not self.beating:
            return []
        self.lapsed = bool(self.enables)
        self.beating, self.enables = False, Enables.NONE
        return [self._frame()]

    def _frame(self) -> Frame:
        self._sent = self.enables
        lamp, gate, motion = (one in self.enables for one in (Enables.LAMP, Enables.GATE, Enables.MOTION))
        return self._sender.frame(MasterAlive(lamp, gate, motion, self.session, self.job))


def after(due: float, cycle: float, now: float) -> float:
    """Time of the next frame: without drift, but never a burst of missed frames."""
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


NICE = -10
"""Nice value requested if real-time scheduling is not granted; the default of a program is 0."""
NONE = "no priority"
"""Beginning of the answer if nothing was granted."""


def raise_priority() -> str:
    """Request real-time scheduling for this process, else a lower nice value; returns the priority granted, or the
    reason why none was.

    To be called before threads start, which inherit it.
    """
    if not hasattr(os, "sched_setscheduler"):
        return f"{NONE}: this system has no real-time scheduling that Python can ask for"
    try:  # the lowest real-time priority is above every ordinary program, and below drivers and audio
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(os.sched_get_priority_min(os.SCHED_FIFO)))
        return "real-time priority"
    except OSError as error:
        refused = error.strerror
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICE)
        return f"nice {NICE}; real-time priority: {refused}"
    except OSError as error:
        return f"{NONE}: {error.strerror}"


if __name__ == "__main__":
    print(raise_priority())

"""Other masters and stop requests on the bus."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from inkloop_hardware.protocol.records import MasterAlive, StopRequest
from inkloop_hardware.protocol.vocabulary import Source

LOG = logging.getLogger("inkloop_hardware")
OVER_AFTER = 0.5
"""Seconds without such a frame after which its sender counts as gone."""
HEARD_OFTEN = 2
"""Frames of another master that make it one; a single one may be the last of a run that just ended."""


@dataclass
class BusWatch:
    """Follows MasterAlive and StopRequest of others and logs each change once. session: our own."""

    session: int
    other: int | None = None
    other_at: float = 0.0
    heard: int = 0
    stop: Source | None = None
    stop_at: float = 0.0

    def take_master(self, now: float, alive: MasterAlive) -> None:
        """Take a MasterAlive of the bus."""
        if alive.session == self.session:
            return
        is_new = self.other != alive.session or now - self.other_at > OVER_AFTER
        self.heard = 1 if is_new else self.heard + 1
        if self.heard == HEARD_OFTEN:
            LOG.warning("another master is active on the bus, session %d: nothing is enabled meanwhile", alive.session)
        self.other, self.other_at = alive.session, now

    def take_stop(self, now: float, request: StopRequest) -> None:
        """Take a StopRequest of the bus."""
        if request.active and self.stop is None:
            LOG.warning("a stop request of the %s", request.source.name.lower())
        self.stop, self.stop_at = (request.source if request.active else None), now

    def stop_request(self, now: float) -> str | None:
        """Message about a stop request that is active at this second, None without one."""
        if self.stop is not None and now - self.stop_at <= OVER_AFTER:
            return (
                f"a stop request of the {self.stop.name.lower()} is active: look at the bench, then release it "
                "(`inkloop bench release SCENARIO`, or where it was made) and `inkloop bench clear SCENARIO`"
            )
        return None

    def other_master(self, now: float) -> str | None:
        """Message about another master that is active at this second, None without one."""
        if self.heard >= HEARD_OFTEN and now - self.other_at <= OVER_AFTER:
            return (
                f"another master is active on this bus, session {self.other}: end it (another run, `inkloop bench`, a "
                "tool that sends MasterAlive), then `inkloop bench clear SCENARIO`"
            )
        return None

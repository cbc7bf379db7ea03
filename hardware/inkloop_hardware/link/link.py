"""The link to one node: its routines, transfers and identifiers over UDS services."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from inkloop_hardware.bus.isotp_connection import Wire
from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.link.node_watch import OFF, because
from inkloop_hardware.link.requests import P2, DeadlinePassed, Requests
from inkloop_hardware.link.transfers import Progress, receive_map, send_pattern
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import (
    Flags,
    Identifier,
    JournalRecord,
    MapSize,
    NodeLimits,
    NodeState,
    NodeTimes,
)
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import Key, Outcome, Routine

CONDITIONS = 0x22
FOR_A_REASON = (CONDITIONS, 0x26)
"""Refusals of a routine that are explained by the state of the node and its cause."""
OUTCOME_S = 5.0
"""Seconds for a node to say what became of a routine (assumed)."""
OUTCOMES = {
    Outcome.UNDER_WAY: "still under way",
    Outcome.UNKNOWN: "begun, and its progress is unknown",
    Outcome.NEVER: "never begun",
}
LATE_ADVICE = "`inkloop bench status SCENARIO` shows what it does; check the device"
ENABLED_AGAIN = 0.15
"""Seconds before a routine is tried a second time: the frame of the heartbeat that enabled it may have been lost."""

Answer = TypeVar("Answer")


@dataclass
class LinkCounts:
    """Problems that were corrected: requests sent again, answers that came late or twice, broken ISO-TP messages,
    transfers that began again.
    """

    repeated: int = 0
    stray: int = 0
    broken: int = 0
    restarted: int = 0


class Link:
    """Sends requests to one node and waits for their answers; made by `Rig.link`.

    A request without an answer within `answer_s` [s] is repeated, six tries in all; answers that come late or twice are
    dropped and counted. A waiting link keeps the heartbeat alive, so its step keeps its enables. Every call may raise
    BusError, NodeLost (silent), NodeStopped (went to SAFE or FAULT meanwhile), NodeRefused and LinkTimeout (no answer
    in all tries).
    """

    def __init__(self, node: Node, codec: Codec, wire: Wire, place: str, *, answer_s: float = P2) -> None:
        self.node = node
        self.requests = Requests(node, codec, wire, place, answer_s=answer_s)
        self.name = self.requests.name
        self._restarted = 0

    @property
    def counts(self) -> LinkCounts:
        """Counts since the link was made."""
        connection = self.requests.connection
        return LinkCounts(self.requests.repeated, connection.stray, connection.broken, self._restarted)

    def download(self, layer: int, blob: bytes, *, coded: bool = False, progress: Progress | None = None) -> None:
        """Transfer a pattern to the head, checked by CRC-32 end to end.

        blob: as described in docs/reference/node-services.md; coded: its cells are run-length coded. The job is that of
        the rig. TransferError if it does not arrive whole in two attempts; a refused layer is a NodeRefused of code
        0x24.
        """
        self._twice(partial(send_pattern, self.requests, layer, blob, coded, progress))

    def upload(self, layer: int, *, progress: Progress | None = None) -> bytes:
        """Transfer the map of the last scan, which must be of this layer, checked by CRC-32 end to end."""
        return self._twice(partial(receive_map, self.requests, layer, progress))

    def routine(self, routine: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
        """Run a routine and wait for its end: DONE, or DONE_BEFORE if nothing was changed.

        limit_s: how long it may last in all; then its outcome is asked for: LinkTimeout with it, unless it is done.
        """
        what = f"{routine.name.lower().replace('_', ' ')} of {key}"
        try:
            answer = self._start(what, routine, bytes(key) + option, limit_s)
        except NodeRefused as refusal:
            if refusal.code not in FOR_A_REASON:
                raise
            state = self.state()
            if refusal.code != CONDITIONS or not _may_follow(routine, state):
                raise NodeRefused(f"{refusal}; it is {state.state.name}{because(state.cause)}", refusal.code) from None
            self.requests.repeated += 1
            self.pause(ENABLED_AGAIN)
            answer = self._start(what, routine, bytes(key) + option, limit_s)
        except DeadlinePassed as late:
            return self._late_outcome(routine, key, late)
        return self._outcome(what, answer)

    def ask(self, routine: Routine, key: Key) -> Outcome:
        """The outcome of a routine as the node knows it; changes nothing."""
        what = f"outcome of {routine.name.lower()} of {key}"
        service = self.requests.client.get_routine_result
        return self._outcome(what, self.requests.request(what, service, routine, bytes(key), limit_s=OUTCOME_S))

    def now(self) -> float:
        """Second of the clock by which its requests wait."""
        return self.requests.wire.now()

    def pause(self, seconds: float) -> None:
        """Wait without a request."""
        self.requests.connection.pause(seconds)

    def state(self) -> NodeState:
        """State, layer and passes (identifier 0100)."""
        return self.requests.read(Identifier.STATE, NodeState.of)

    def times(self) -> NodeTimes:
        """Times at which its interlocks acted last (0101)."""
        return self.requests.read(Identifier.TIMES, NodeTimes.of)

    def limits(self) -> NodeLimits:
        """Its limits (0102)."""
        return self.requests.read(Identifier.LIMITS, NodeLimits.of)

    def map_size(self) -> MapSize:
        """Size of the map of the last scan (0103)."""
        return self.requests.read(Identifier.MAP, MapSize.of)

    def journal(self) -> tuple[JournalRecord, ...]:
        """The records of its journal, newest first (0110)."""
        return self.requests.read(Identifier.JOURNAL, JournalRecord.of)

    def version(self) -> str:
        """Its firmware (F195)."""
        return self.requests.read(Identifier.VERSION, lambda data: data.decode("ascii", "replace"))

    def _start(self, what: str, routine: Routine, option: bytes, limit_s: float) -> Any:
        return self.requests.request(what, self.requests.client.start_routine, routine, option, limit_s=limit_s)

    def _late_outcome(self, routine: Routine, key: Key, late: DeadlinePassed) -> Outcome:
        """Outcome of a routine whose time is over; LinkTimeout if it is not done."""
        try:
            outcome = self.ask(routine, key)
        except (LinkTimeout, NodeRefused, TransferError) as error:
            raise LinkTimeout(f"{late}; asked for its outcome it gave none. {LATE_ADVICE}") from error
        if outcome in (Outcome.DONE, Outcome.DONE_BEFORE):
            return outcome
        raise LinkTimeout(f"{late}; asked for its outcome it answered: {OUTCOMES[outcome]}. {LATE_ADVICE}") from late

    def _outcome(self, what: str, answer: Any) -> Outcome:
        record = answer.service_data.routine_status_record
        return self.requests.decoded(what, record, lambda data: Outcome(data[0]))

    def _twice(self, transfer: Callable[[], Answer]) -> Answer:
        """Transfer, and once more from the beginning if bytes were lost or altered."""
        try:
            return transfer()
        except TransferError:
            self._restarted += 1
        return transfer()


def _may_follow(routine: Routine, state: NodeState) -> bool:
    """Whether a node that refused a routine may take it after the next heartbeat."""
    if routine is Routine.CLEAR:
        return not state.flags & (Flags.NEEDS_OPERATOR | Flags.STOPPED)
    return state.state not in OFF

"""What is asked of one node, over ISO-TP and UDS services, with retries."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import udsoncan
from udsoncan.client import Client
from udsoncan.exceptions import (
    NegativeResponseException,
    TimeoutException,
)

from inkloop_hardware.bus.isotp_connection import ANSWER_LIMIT, IsoTpConnection, Wire
from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.link.node_watch import OFF, because
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
    TransferState,
)
from inkloop_hardware.protocol.services import REFUSALS, UNREADABLE, Bytes, Key, Outcome, Routine, is_answer
from inkloop_hardware.protocol.vocabulary import Node

TRIES = 6
P2 = 1.0
"""Seconds for a node to begin its answer."""
P2_STAR = 5.0
"""Seconds between two "still busy"; a node says it every second."""
CONDITIONS = 0x22
FOR_A_REASON = (CONDITIONS, 0x26)
"""Refusals of a routine that its state and its cause explain."""
ENABLED_AGAIN = 0.15
"""Seconds after which a node that might have been willing is asked again: the frame of the heartbeat that enabled the
step may have been lost, and the next ones came since."""

Answer = TypeVar("Answer")


@dataclass
class LinkCounts:
    """What went wrong and was mended: requests sent again, answers that came late or twice, broken ISO-TP messages,
    transfers begun anew."""

    again: int = 0
    stray: int = 0
    broken: int = 0
    anew: int = 0


class Link:
    """Talks to one node; made by `Rig.link`.

    A request without an answer within 1 s is repeated, six tries in all; answers that come late or twice are dropped
    and counted. While a link waits it says that the control loop lives, so a step that is waited for keeps its enables.
    Every call may raise BusError, NodeLost (silent), NodeStopped (fell to SAFE or FAULT meanwhile), NodeRefused (a
    refusal, in words) and LinkTimeout (all tries in vain).
    """

    def __init__(self, node: Node, codec: Codec, wire: Wire, place: str) -> None:
        self.node = node
        self.name = f"{node.lower()} (0x{codec.answer_id(node):03X} on {place})"
        self._wire = wire
        self._again = 0
        self._anew = 0
        self._unsure = False
        """Answers to requests of before may still come."""
        self._connection = IsoTpConnection(wire, codec.request_id(node), codec.answer_id(node), is_answer)
        config: Any = dict(udsoncan.configs.default_client_config)
        config |= {"data_identifiers": {"default": Bytes()}, "request_timeout": None}
        config |= {"p2_timeout": P2, "p2_star_timeout": P2_STAR, "use_server_timing": False}
        self.client = Client(self._connection, config=config)
        self.client.logger = logging.getLogger("inkloop_uds")
        self.client.logger.setLevel(logging.CRITICAL)  # what it logs as an error is tried again, or raised

    @property
    def counts(self) -> LinkCounts:
        """Since it was made."""
        return LinkCounts(self._again, self._connection.stray, self._connection.broken, self._anew)

    def download(self, layer: int, blob: bytes, *, coded: bool = False, progress: Progress | None = None) -> None:
        """Brings a pattern to the head, checked by CRC-32 end to end.

        blob: as docs/reference/node-services.md has it; coded: its cells are run-length coded. The job is that of the
        rig. TransferError if it does not arrive whole in two attempts; a refused layer is a NodeRefused of code 0x24.
        """
        self._twice(lambda: send_pattern(self, layer, blob, coded, progress))

    def upload(self, layer: int, *, progress: Progress | None = None) -> bytes:
        """Fetches the map of the last scan, which must be of this layer, checked by CRC-32 end to end."""
        return self._twice(lambda: receive_map(self, layer, progress))

    def routine(self, routine: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
        """Has a node do something and waits until it is done: DONE, or DONE_BEFORE if nothing was changed.

        limit_s: how long it may last in all; then LinkTimeout, and what became of it is to be asked (`ask`).
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
            self._again += 1
            self._connection.pause(ENABLED_AGAIN)
            answer = self._start(what, routine, bytes(key) + option, limit_s)
        return self._outcome(what, answer)

    def _start(self, what: str, routine: Routine, option: bytes, limit_s: float) -> Any:
        self._connection.deadline = self._wire.now() + limit_s
        try:
            return self.request(what, lambda: self.client.start_routine(routine, option))
        finally:
            self._connection.deadline = None

    def ask(self, routine: Routine, key: Key) -> Outcome:
        """What is known of a routine; changes nothing."""
        what = f"what became of {routine.name.lower()} of {key}"
        answer = self.request(what, lambda: self.client.get_routine_result(routine, bytes(key)))
        return self._outcome(what, answer)

    def state(self) -> NodeState:
        """State, layer and passes (identifier 0100)."""
        return self._read(Identifier.STATE, NodeState.of)

    def times(self) -> NodeTimes:
        """When its interlocks acted last (0101)."""
        return self._read(Identifier.TIMES, NodeTimes.of)

    def limits(self) -> NodeLimits:
        """What it bears (0102)."""
        return self._read(Identifier.LIMITS, NodeLimits.of)

    def map_size(self) -> MapSize:
        """Size of the map of the last scan (0103)."""
        return self._read(Identifier.MAP, MapSize.of)

    def transfer(self) -> TransferState:
        """How far a transfer has come (0104)."""
        return self._read(Identifier.TRANSFER, TransferState.of)

    def journal(self) -> tuple[JournalRecord, ...]:
        """What it remembers, newest first (0110)."""
        return self._read(Identifier.JOURNAL, JournalRecord.of)

    def version(self) -> str:
        """Its firmware (F195)."""
        return self._read(Identifier.VERSION, lambda data: data.decode("ascii", "replace"))

    def request(self, what: str, ask: Callable[[], Any], tries: int = TRIES) -> Any:
        """The answer of a request of `client`, repeated until one comes; `what` names it in errors."""
        if self._connection.deadline is not None:
            return self._tried(what, ask, tries)
        self._connection.deadline = self._wire.now() + ANSWER_LIMIT
        try:
            return self._tried(what, ask, tries)
        finally:
            self._connection.deadline = None

    def _tried(self, what: str, ask: Callable[[], Any], tries: int) -> Any:
        if self._unsure:
            self._settle()
        for _ in range(tries):
            try:
                answer = ask()
            except TimeoutException:
                self._again += 1
                self._unsure = True
                self._check_deadline(what)
            except NegativeResponseException as error:
                code = error.response.code or 0
                raise NodeRefused(f"the {self.name} refuses: {what} (0x{code:02X}): {_words(code)}", code) from None
            except UNREADABLE as error:
                raise TransferError(f"the {self.name} answers what cannot be read: {what}: {error}") from error
            except BaseException:
                self._unsure = True
                raise
            else:
                return answer
        raise LinkTimeout(f"no answer of the {self.name} within {P2:g} s, {tries} tries: {what}; {_advice()}")

    def _read(self, identifier: Identifier, of: Callable[[bytes], Answer]) -> Answer:
        what = f"identifier {identifier:04X}, {identifier.name.lower()}"
        answer = self.request(what, lambda: self.client.read_data_by_identifier(identifier))
        return self._understood(what, answer.service_data.values[int(identifier)], of)

    def _outcome(self, what: str, answer: Any) -> Outcome:
        return self._understood(what, answer.service_data.routine_status_record, lambda record: Outcome(record[0]))

    def _understood(self, what: str, data: bytes, of: Callable[[bytes], Answer]) -> Answer:
        try:
            return of(data)
        except (ValueError, ArithmeticError, struct.error) as error:
            raise TransferError(
                f"the {self.name} answers {what} with {data.hex(' ')}: {error}; is it newer?"
            ) from error

    def _settle(self) -> None:
        """Answers come in the order of their requests: after that to a question of its own, none is old."""
        self._unsure = False
        self.request("are you there (0x3E)", self.client.tester_present)
        self._unsure = False

    def _check_deadline(self, what: str) -> None:
        deadline = self._connection.deadline
        if deadline is not None and self._wire.now() > deadline:
            raise LinkTimeout(f"the {self.name} has not ended in time: {what}; ask it what became of it")

    def _twice(self, transfer: Callable[[], Answer]) -> Answer:
        """Once more from the beginning, if bytes were lost or altered on the way."""
        try:
            return transfer()
        except TransferError:
            self._anew += 1
        return transfer()


def _may_follow(routine: Routine, state: NodeState) -> bool:
    """Whether a node that refused a routine takes it once it has heard the heartbeat."""
    if routine is Routine.CLEAR:
        return not state.flags & (Flags.NEEDS_OPERATOR | Flags.STOPPED)
    return state.state not in OFF


def _words(code: int) -> str:
    return REFUSALS.get(code, "a code that this protocol does not have; does it run other firmware?")


def _advice() -> str:
    return "its status frames come in, so look at what its firmware does"

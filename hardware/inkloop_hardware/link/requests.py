"""Requests to one node over UDS and ISO-TP: each is repeated until its answer comes or its time is over."""

from __future__ import annotations

import logging
import struct
from collections.abc import Callable
from typing import Any, TypeVar

import udsoncan
from udsoncan.client import Client
from udsoncan.exceptions import NegativeResponseException, TimeoutException

from inkloop_hardware.bus.isotp_connection import ANSWER_LIMIT, MESSAGE_QUIET, IsoTpConnection, Wire
from inkloop_hardware.errors import LinkTimeout, NodeRefused, TransferError
from inkloop_hardware.protocol.codec import Codec
from inkloop_hardware.protocol.node_state import Identifier
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import REFUSALS, UNREADABLE, Bytes, is_answer

TRIES = 6
P2 = 1.0
"""Seconds for a node to begin its answer."""
P2_STAR = 5.0
"""Seconds between two "still busy"; a node sends it every second."""

Answer = TypeVar("Answer")


class DeadlinePassed(LinkTimeout):
    """A request was not done when its time was over; the node may still be at it."""


class Requests:
    """Sends requests to one node and returns its answers.

    A request without an answer within `answer_s` [s] is repeated, six tries in all; answers that come late or twice are
    dropped. name: the node with its arbitration id and its bus, for messages; client: its services; connection: counts
    answers that came late or twice and broken messages; repeated: requests sent again.
    """

    def __init__(self, node: Node, codec: Codec, wire: Wire, place: str, *, answer_s: float = P2) -> None:
        self.name = f"{node.lower()} (0x{codec.answer_id(node):03X} on {place})"
        self.repeated = 0
        self.wire, self._answer_s = wire, answer_s
        self._unsure = False
        """Answers to earlier requests may still come."""
        ids = codec.request_id(node), codec.answer_id(node)
        self.connection = IsoTpConnection(wire, *ids, is_answer, quiet_s=MESSAGE_QUIET * answer_s / P2)
        config: Any = dict(udsoncan.configs.default_client_config)
        config |= {"data_identifiers": {"default": Bytes()}, "request_timeout": None}
        config |= {"p2_timeout": answer_s, "p2_star_timeout": max(P2_STAR, answer_s), "use_server_timing": False}
        self.client = Client(self.connection, config=config)
        self.client.logger = logging.getLogger("inkloop_uds")
        self.client.logger.setLevel(logging.CRITICAL)  # its errors are repeated here, or raised

    def request(
        self,
        what: str,
        service: Callable[..., Any],
        *arguments: object,
        tries: int = TRIES,
        limit_s: float = ANSWER_LIMIT,
    ) -> Any:
        """The answer to a service of `client` with these arguments, repeated until one comes.

        what: names the request in errors; limit_s: for all tries together. Raises LinkTimeout, NodeRefused,
        TransferError for an answer that cannot be read, and what `wire` raises.
        """
        self.connection.deadline = self.wire.now() + limit_s
        try:
            if self._unsure:
                self._settle()
            return self._repeat(what, service, *arguments, tries=tries)
        finally:
            self.connection.deadline = None

    def read(self, identifier: Identifier, of: Callable[[bytes], Answer]) -> Answer:
        """The record of an identifier (service 0x22); `of` makes it of its bytes."""
        what = f"identifier {identifier:04X}, {identifier.name.lower()}"
        answer = self.request(what, self.client.read_data_by_identifier, identifier)
        return self.decoded(what, answer.service_data.values[int(identifier)], of)

    def decoded(self, what: str, data: bytes, of: Callable[[bytes], Answer]) -> Answer:
        """The bytes of an answer as `of` reads them; TransferError for bytes that it cannot read."""
        try:
            return of(data)
        except (ValueError, ArithmeticError, struct.error) as error:
            raise TransferError(
                f"the {self.name} answers {what} with {data.hex(' ')}: {error}; is it newer?"
            ) from error

    def _repeat(self, what: str, service: Callable[..., Any], *arguments: object, tries: int) -> Any:
        before = self.spoilt
        for _ in range(tries):
            try:
                answer = service(*arguments)
            except TimeoutException:
                self.repeated += 1
                self._unsure = True
                self._check_deadline(what)
            except NegativeResponseException as error:
                code = error.response.code or 0
                raise NodeRefused(f"the {self.name} refuses: {what} (0x{code:02X}): {_reason(code)}", code) from None
            except UNREADABLE as error:
                raise TransferError(f"the {self.name} sends an invalid answer: {what}: {error}") from error
            except BaseException:
                self._unsure = True
                raise
            else:
                return answer
        spoilt = self.spoilt_frames(before)
        raise LinkTimeout(
            f"no {'whole ' if spoilt else ''}answer of the {self.name} within {self._answer_s:g} s, {tries} tries: "
            f"{what}; {spoilt or 'its status frames arrive, so check its firmware'}"
        )

    @property
    def spoilt(self) -> int:
        """Frames and messages of the node so far that arrived and answered nothing."""
        return self.connection.broken + self.connection.stray

    def spoilt_frames(self, before: int) -> str:
        """Those since there were `before`, in words and with what to do; empty if there are none."""
        count = self.spoilt - before
        return f"{count} of its frames came damaged, out of order or late: check cables and termination" * (count > 0)

    def _settle(self) -> None:
        """Sends a question of its own: answers come in the order of their requests, so all later answers are new."""
        self._unsure = False
        self._repeat("are you there (0x3E)", self.client.tester_present, tries=TRIES)
        self._unsure = False

    def _check_deadline(self, what: str) -> None:
        deadline = self.connection.deadline
        if deadline is not None and self.wire.now() > deadline:
            raise DeadlinePassed(f"the {self.name} has not ended in time: {what}")


def _reason(code: int) -> str:
    return REFUSALS.get(code, "a code that this protocol does not have; does it run other firmware?")

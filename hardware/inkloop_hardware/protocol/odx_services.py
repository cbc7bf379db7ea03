"""Requests and responses of a node as services of ODX (ISO 22901-1)."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

from odxtools.diagservice import DiagService
from odxtools.nameditemlist import NamedItemList
from odxtools.odxlink import OdxLinkRef
from odxtools.odxtypes import DataType
from odxtools.parameters.parameter import Parameter
from odxtools.request import Request
from odxtools.response import Response, ResponseType
from udsoncan.ResponseCode import ResponseCode

from inkloop_hardware.protocol.layout import Part, parts
from inkloop_hardware.protocol.node_state import (
    Identifier,
    JournalRecord,
    MapSize,
    NodeLimits,
    NodeState,
    NodeTimes,
    Session,
    TransferState,
)
from inkloop_hardware.protocol.odx_values import Dictionary, const, echo, echoes, made_id
from inkloop_hardware.protocol.records import Node
from inkloop_hardware.protocol.services import NEGATIVE, OPTIONS, POSITIVE, REFUSALS, ROUTINES, Key, Outcome, Routine

SESSION, READ, ROUTINE, DOWNLOAD, UPLOAD, BLOCK, EXIT, PRESENT = 0x10, 0x22, 0x31, 0x34, 0x35, 0x36, 0x37, 0x3E
RECORDS = {
    Identifier.STATE: NodeState,
    Identifier.TIMES: NodeTimes,
    Identifier.LIMITS: NodeLimits,
    Identifier.MAP: MapSize,
    Identifier.TRANSFER: TransferState,
}
OF_ALL = (Routine.CLEAR, Routine.DRY_RUN)
STARTED, ASKED = 1, 3
"""Sub-functions of 0x31."""
MEMORY, BLOCK_BYTES = (4, 4), 2
"""Bytes of address and size in a request for a transfer; of the longest block in its answer."""
COUNTER, CRC = Part("counter", int, 1), Part("crc", int, 4)


class Coding(IntEnum):
    """Coding of the cells of a pattern."""

    PLAIN = 0x00
    RUN_LENGTH = 0x10


class Services:
    """The services of a layer; `fields` are those of its diagnostic layer that hold them."""

    def __init__(self, layer: str, dictionary: Dictionary) -> None:
        self._layer, self._dictionary = layer, dictionary
        self._services: list[Any] = []
        self._requests: list[Request] = []
        self._responses: list[Response] = []

    def fields(self) -> dict[str, Any]:
        """Services, requests and positive responses."""
        return {
            "diag_comms_raw": self._services,
            "requests": NamedItemList(self._requests),
            "positive_responses": NamedItemList(self._responses),
        }

    def of_all(self) -> None:
        """Add the services of every node."""
        values = self._dictionary.values
        session = Part("session", Session, 1)
        times = (Part("p2", float, 2), Part("p2_star_in_10_ms", int, 2))
        answer = [echo(session, 1, of=1), *values(times, 2)]
        self._add("Session", SESSION, values([session], 1), answer)
        self._add("TesterPresent", PRESENT, [const("subfunction", 1, 0)], [const("subfunction", 1, 0)])
        for identifier in Identifier:
            if identifier is not Identifier.MAP:
                self._read(identifier)
        for routine in OF_ALL:
            self._routine(routine)

    def of(self, node: Node) -> None:
        """Add the services of this node alone."""
        for routine in ROUTINES[node]:
            self._routine(routine)
        if node is Node.HEAD:
            self._of_head()
        if node is Node.PROFILER:
            self._of_profiler()

    def _of_head(self) -> None:
        values, rest = self._dictionary.values, self._dictionary.rest
        self._begin("RequestDownload", DOWNLOAD, values([Part("coding", Coding, 1)], 1))
        block = [*values([COUNTER], 1), rest("data", 2)]
        self._add("TransferBlock", BLOCK, block, [echo(COUNTER, 1, of=1)])
        self._add("TransferEnd", EXIT, values([CRC], 1), values([CRC], 1))

    def _of_profiler(self) -> None:
        self._read(Identifier.MAP)
        values, rest = self._dictionary.values, self._dictionary.rest
        self._begin("RequestUpload", UPLOAD, [const("coding", 1, 0)])
        answer = [echo(COUNTER, 1, of=1), rest("data", 2)]
        self._add("TransferBlock", BLOCK, values([COUNTER], 1), answer)
        most = Part("most", int, 2)
        self._add("TransferBlockOfAtMost", BLOCK, values([COUNTER, most], 1), answer)
        self._add("TransferEnd", EXIT, [], values([CRC], 1))

    def _begin(self, name: str, service: int, coding: Sequence[Parameter]) -> None:
        """Of a transfer: the layer is its address."""
        address, size = MEMORY
        place = [Part("layer", int, address), Part("size", int, size)]
        request = [*coding, const("place_bytes", 2, size << 4 | address), *self._dictionary.values(place, 3)]
        longest = self._dictionary.values([Part("block", int, BLOCK_BYTES)], 2)
        self._add(name, service, request, [const("block_bytes", 1, BLOCK_BYTES << 4), *longest])

    def _read(self, identifier: Identifier) -> None:
        at = 3
        if identifier in RECORDS:
            found = self._dictionary.values(parts(RECORDS[identifier]), at)
        elif identifier is Identifier.JOURNAL:
            found = [self._dictionary.records("records", at, JournalRecord)]
        elif identifier is Identifier.SESSION:
            found = self._dictionary.values([Part("session", Session, 1)], at)
        else:
            found = [self._dictionary.rest("version", at, DataType.A_ASCIISTRING)]
        asked = const("identifier", 1, identifier, size=2)
        self._add(f"Read{_title(identifier)}", READ, [asked], [asked, *found])

    def _routine(self, routine: Routine) -> None:
        key, at = parts(Key), 4
        end = at + sum(part.size for part in key)
        option = [OPTIONS[routine]] if routine in OPTIONS else []
        for word, kind in ("Start", STARTED), ("Ask", ASKED):
            head = [const("kind", 1, kind), const("routine", 2, routine, size=2)]
            request = [*head, *self._dictionary.values(key, at)]
            if kind == STARTED:
                request += self._dictionary.values(option, end)
            outcome = self._dictionary.values([Part("outcome", Outcome, 1)], at)
            answer = [*head, *outcome, *echoes(key, at + 1, of=at)]
            self._add(f"{word}{_title(routine)}", ROUTINE, request, answer)

    def _add(self, name: str, service: int, request: Sequence[Parameter], answer: Sequence[Parameter]) -> None:
        head = const("service", 0, service), const("service", 0, service + POSITIVE)
        asked = Request(
            odx_id=made_id(self._layer, f"{name}.request"),
            short_name=f"{name}_request",
            parameters=NamedItemList([head[0], *request]),
        )
        answered = Response(
            odx_id=made_id(self._layer, f"{name}.answer"),
            short_name=f"{name}_answer",
            response_type=ResponseType.POSITIVE,
            parameters=NamedItemList([head[1], *answer]),
        )
        self._requests.append(asked)
        self._responses.append(answered)
        self._services.append(
            DiagService(
                odx_id=made_id(self._layer, name),
                short_name=name,
                request_ref=OdxLinkRef.from_id(asked.odx_id),
                pos_response_refs=[OdxLinkRef.from_id(answered.odx_id)],
            )
        )


def refusal(layer: str, dictionary: Dictionary) -> Response:
    """The negative response to any request; its code is a word of ISO 14229-1, explained by the remedy."""
    codes = [(code, ResponseCode.get_name(code), why) for code, why in REFUSALS.items()]
    asked = echo(Part("refused", int, 1), 1, of=0)
    return Response(
        odx_id=made_id(layer, "refusal"),
        short_name="refusal",
        response_type=ResponseType.GLOBAL_NEGATIVE,
        parameters=NamedItemList(
            [const("service", 0, NEGATIVE), asked, dictionary.words("code", 2, "RefusalCode", codes)]
        ),
    )


def _title(name: IntEnum) -> str:
    """SelfTest of SELF_TEST."""
    return name.name.title().replace("_", "")

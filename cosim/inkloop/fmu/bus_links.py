"""Buses between two partners (FMI-LS-BUS): operations are carried at every communication point."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from inkloop.component import Values
from inkloop.errors import ComponentError
from inkloop.fmu.bus import CONFIGURATION, CONFIRM, STATUS, operations

ROUNDS_MAX = 100
"""Answers to answers at one communication point."""
_OF_THE_BUS = (CONFIRM, CONFIGURATION, STATUS)
"""Operations that an ideal bus does not carry to the other node."""


class BusEnd(NamedTuple):
    """A bus of a component."""

    component: str
    bus: str

    def __str__(self) -> str:
        """As in a scenario."""
        return f"{self.component}.{self.bus}"


@dataclass(frozen=True)
class BusLink:
    """Two ends of a bus; ideal: both are nodes, and what each sends is carried and confirmed by the master, else one
    is a bus simulation, which does that.
    """

    ends: tuple[BusEnd, BusEnd]
    ideal: bool


class BusLinks:
    """An observer of the master that carries what the components of `links` send, which are FMUs. Raises
    ComponentError.
    """

    def __init__(self, components: Mapping[str, Any], links: Sequence[BusLink]) -> None:
        self._links = links
        self._exchanges: dict[str, Callable[[Mapping[str, bytes]], dict[str, bytes]]] = {
            end.component: components[end.component].exchange for link in links for end in link.ends
        }

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """At the start."""
        self._carry()

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """After each step."""
        self._carry()

    def _carry(self) -> None:
        given: dict[str, dict[str, bytes]] = {}
        for _ in range(ROUNDS_MAX):
            sent = {name: exchange(given.get(name, {})) for name, exchange in self._exchanges.items()}
            given = self._delivered(sent)
            if not given:
                return
        found = " and ".join(f"{one} and {other}" for one, other in (link.ends for link in self._links))
        raise ComponentError(f"buses of {found}: operations at one time do not end after {ROUNDS_MAX} rounds")

    def _delivered(self, sent: Mapping[str, Mapping[str, bytes]]) -> dict[str, dict[str, bytes]]:
        """Operations for each component on its buses."""
        given: dict[str, dict[str, bytes]] = {}
        for link in self._links:
            for end, other in (link.ends, link.ends[::-1]):
                content = sent[end.component].get(end.bus, b"")
                carried, answers = _through(content) if link.ideal else (content, b"")
                for taker, part in ((other, carried), (end, answers)):
                    if part:
                        buses = given.setdefault(taker.component, {})
                        buses[taker.bus] = buses.get(taker.bus, b"") + part
        return given


def _through(content: bytes) -> tuple[bytes, bytes]:
    """Operations of an ideal bus: those for the other node, and those for the sender."""
    found = list(operations(content))
    carried = b"".join(each.content for each in found if each.is_known and each.code not in _OF_THE_BUS)
    return carried, b"".join(each.answer for each in found)

"""What is asked of one node, over ISO-TP and UDS services, with retries."""

from __future__ import annotations

from collections.abc import Callable

from inkloop_hardware.node_state import JournalRecord, MapSize, NodeLimits, NodeState, NodeTimes
from inkloop_hardware.services import Key, Outcome, Routine
from inkloop_hardware.vocabulary import Node

Progress = Callable[[int, int], None]
"""Called with bytes that went through and bytes in all."""


class Link:
    """Talks to one node; made by `Rig.link`.

    A request without an answer within 1 s is repeated, six tries in all; answers that come late or twice are dropped
    and counted. While a link waits it says that the control loop lives, so a step that is waited for keeps its enables.
    Every call may raise BusError, NodeLost (silent), NodeStopped (fell to SAFE or FAULT meanwhile), NodeRefused (a
    refusal, in words) and LinkTimeout (all tries in vain).
    """

    node: Node

    def download(self, layer: int, blob: bytes, *, coded: bool = False, progress: Progress | None = None) -> None:
        """Brings a pattern to the head, checked by CRC-32 end to end.

        blob: as docs/reference/node-services.md has it; coded: its cells are run-length coded. The job is that of the
        rig. TransferError if it does not arrive whole in two attempts; a refused layer is a NodeRefused of code 0x24.
        """
        raise NotImplementedError

    def upload(self, layer: int, *, progress: Progress | None = None) -> bytes:
        """Fetches the map of the last scan, which must be of this layer, checked by CRC-32 end to end."""
        raise NotImplementedError

    def routine(self, routine: Routine, key: Key, option: bytes = b"", *, limit_s: float) -> Outcome:
        """Has a node do something and waits until it is done: DONE, or DONE_BEFORE if nothing was changed.

        limit_s: how long it may last in all; then LinkTimeout, and what became of it is to be asked (`ask`).
        """
        raise NotImplementedError

    def ask(self, routine: Routine, key: Key) -> Outcome:
        """What is known of a routine; changes nothing."""
        raise NotImplementedError

    def state(self) -> NodeState:
        """State, layer and passes (identifier 0100)."""
        raise NotImplementedError

    def times(self) -> NodeTimes:
        """When its interlocks acted last (0101)."""
        raise NotImplementedError

    def limits(self) -> NodeLimits:
        """What it bears (0102)."""
        raise NotImplementedError

    def map_size(self) -> MapSize:
        """Size of the map of the last scan (0103)."""
        raise NotImplementedError

    def journal(self) -> tuple[JournalRecord, ...]:
        """What it remembers, newest first (0110)."""
        raise NotImplementedError

    def version(self) -> str:
        """Its firmware (F195)."""
        raise NotImplementedError

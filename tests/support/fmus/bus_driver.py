"""BenchBus.fmu as a partner on its bus sees it: frames in, operations out, at every communication point."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Self

from inkloop.fmu.bus import BusFrame, Operation, operations, transmit
from support.fmus.fmu_driver import OK, Driver

MODEL = "BenchBus"
INSTANTS_MAX = 10
ARE_YOU_THERE = transmit(BusFrame(0x640, bytes.fromhex("023e00cccccccccc")))
"""TesterPresent, to the head."""


class BusDriver(Driver):
    """A bench in Event Mode or Step Mode; `sent`: (time, operation) of all that the nodes have sent."""

    def __init__(self, form: str = "fmi3", nx: int = 9, ny: int = 9, folder: Path | None = None) -> None:
        super().__init__(MODEL, form, nx, ny, folder)
        self.sent: list[tuple[float, Operation]] = []

    def begin(self, **parameters: object) -> Self:
        """In Step Mode."""
        self.start(parameters)
        assert self.handle() == OK
        return self

    def handle(self, given: bytes = b"") -> int:
        """One stay in Event Mode, which has been entered; the worst status."""
        status = OK
        if given:
            status = max(self.tick(), self.give(given))
        again = True
        for _ in range(INSTANTS_MAX):
            if not again:
                break
            if self.fmu.getClock(self.references["Tx_Clock"])[0]:
                (content,) = self.fmu.getBinary(self.references["Tx_Data"])
                self.sent += [(self.now, found) for found in operations(content)]
            again, *_ = self.fmu.updateDiscreteStates()
        assert not again, "Event Mode does not end"
        return max(status, self.call("enterStepMode"))

    def tick(self, name: str = "Rx_Clock", value: bool = True) -> int:
        """Set a clock."""
        return self.call("setClock", self.references[name], [value])

    def give(self, content: bytes, name: str = "Rx_Data") -> int:
        """Set a binary."""
        return self.call("setBinary", self.references[name], [content])

    def go(self, step: float, given: bytes = b"") -> None:
        """A step, after operations were given, and its events."""
        if given:
            assert self.call("enterEventMode") == OK
            assert self.handle(given) == OK, self.messages
        is_event, *_ = self.fmu.doStep(self.now, step)
        self.now += step
        if is_event:
            assert self.call("enterEventMode") == OK
            assert self.handle() == OK

    def frames(self, *identifiers: int) -> Sequence[BusFrame]:
        """The frames sent, of these identifiers if any are named."""
        found = [operation.frame for _, operation in self.sent]
        return [frame for frame in found if frame and (not identifiers or frame.identifier in identifiers)]

"""An FMU with one CAN bus (FMI-LS-BUS), stepped by its partner on that bus: frames in, frames out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from inkloop.errors import FmuError
from inkloop.fmu.bus import FORMAT_ERROR, BusFrame, operations, transmit
from inkloop.fmu.component import FmuComponent


class BusNode:
    """Starts the FMU; parameters: of the FMU, by name. Raises FmuError, later ComponentError."""

    def __init__(self, path: Path | str, parameters: Mapping[str, object]) -> None:
        self._fmu = FmuComponent(path, parameters=parameters)
        buses, unserved = self._fmu.description.buses, self._fmu.description.unserved
        if len(buses) != 1 or unserved:
            found = "; ".join([*(bus.name for bus in buses), *(f"{name}: {why}" for name, why in unserved.items())])
            self._fmu.terminate()
            raise FmuError(f"{path}: expected an FMU with one CAN bus (FMI-LS-BUS), its buses are {found or 'none'}")
        self._bus = buses[0].name
        self._answers = b""
        self._fmu.initialize(0, {})

    def step(self, time_ns: int, step_ns: int, frames: Iterable[tuple[int, bytes, bool, bool]]) -> list[BusFrame]:
        """Give frames, then step; the frames that the FMU has sent. Raises FmuError for what it could not read."""
        given = self._answers + b"".join(transmit(BusFrame(*frame)) for frame in frames)
        if given:
            sent = self._fmu.exchange({self._bus: given})
            self._answers = b""
        else:
            sent = {}
        self._fmu.advance(time_ns, step_ns, {})
        later = self._fmu.exchange({})
        return list(self._read(sent.get(self._bus, b"") + later.get(self._bus, b"")))

    def close(self) -> None:
        """End the FMU."""
        self._fmu.terminate()

    def _read(self, content: bytes) -> Iterable[BusFrame]:
        for found in operations(content):
            if found.code == FORMAT_ERROR:
                wrong = found.content.hex()
                raise FmuError(f"{self._bus}: the FMU could not read an operation of its partner: {wrong}")
            if frame := found.frame:
                yield frame
            self._answers += found.answer

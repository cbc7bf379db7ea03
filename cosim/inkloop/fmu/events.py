"""Event Mode of a running FMU (FMI 3): what its buses take and send."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Mapping, Sequence

from fmpy import fmi3

from inkloop.errors import ComponentError
from inkloop.fmu.binding import Binding
from inkloop.fmu.bus_terminals import COUNTDOWN, BusTerminal

INSTANTS_MAX = 1000
"""Instants of Event Mode at one time; an FMU that asks for more never comes to an end."""
_CHANGED = 2
_ROUNDING_S = 1e-9


class Events:
    """Event Mode of an FMU with clocks, which begins with the end of initialisation."""

    def __init__(self, binding: Binding, buses: Sequence[BusTerminal]) -> None:
        self._binding = binding
        self._buses = buses
        self._due = {bus.tx_clock: math.inf for bus in buses if bus.tx_interval == COUNTDOWN}
        self._is_inside = True

    def is_due(self, time: float) -> bool:
        """Whether a countdown has ended by `time` [s]."""
        return any(due <= time + _ROUNDING_S for due in self._due.values())

    def handle(self, time: float, received: Mapping[str, bytes]) -> dict[str, bytes]:
        """One stay in Event Mode at `time` [s]: operations for buses by name; returns what the buses send."""
        if not self._is_inside:
            self._binding.call("enterEventMode")
        sent = {bus.name: b"" for bus in self._buses}
        for _ in range(INSTANTS_MAX):
            counted = self._set(time, received)  # all inputs come before the first output
            for bus in self._buses:
                is_countdown = bus.tx_interval == COUNTDOWN
                ticks = bus.tx_clock in counted if is_countdown else self._binding.call("getClock", [bus.tx_clock])[0]
                if ticks:
                    (content,) = self._binding.call("getBinary", [bus.tx_data])
                    sent[bus.name] += content or b""
            received = {}
            (again, *_) = self._binding.call("updateDiscreteStates")
            self._count_down(time)
            if not again and not self.is_due(time):
                self._binding.call("enterStepMode")
                self._is_inside = False
                return {name: content for name, content in sent.items() if content}
        raise ComponentError(f"Event Mode at {time:g} s does not end: {INSTANTS_MAX} instants")

    def _set(self, time: float, received: Mapping[str, bytes]) -> set[int]:
        """Set clocks and operations of an instant; the countdown clocks that tick."""
        counted = {clock for clock, due in self._due.items() if due <= time + _ROUNDING_S}
        given = {bus: received[bus.name] for bus in self._buses if received.get(bus.name)}
        clocks = [*counted, *(bus.rx_clock for bus in given)]
        if clocks:
            self._binding.call("setClock", clocks, [True] * len(clocks))
        for bus, content in given.items():
            self._binding.call("setBinary", [bus.rx_data], [content])
        self._due |= dict.fromkeys(counted, math.inf)
        return counted

    def _count_down(self, time: float) -> None:
        for clock in self._due:
            reference = (fmi3.fmi3ValueReference * 1)(clock)
            interval, qualifier = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
            self._binding.call("getIntervalDecimal", reference, interval, qualifier)
            if qualifier[0] == _CHANGED:
                self._due[clock] = time + interval[0]

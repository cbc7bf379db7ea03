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
            for bus in self._buses:
                if operations := received.get(bus.name):
                    self._binding.call("setClock", [bus.rx_clock], [True])
                    self._binding.call("setBinary", [bus.rx_data], [operations])
                sent[bus.name] += self._taken(bus, time)
            received = {}
            (again, *_) = self._binding.call("updateDiscreteStates")
            self._count_down(time)
            if not again and not self.is_due(time):
                self._binding.call("enterStepMode")
                self._is_inside = False
                return {name: content for name, content in sent.items() if content}
        raise ComponentError(f"Event Mode at {time:g} s does not end: {INSTANTS_MAX} instants")

    def _taken(self, bus: BusTerminal, time: float) -> bytes:
        """The operations of a bus whose clock ticks now."""
        if bus.tx_interval == COUNTDOWN:
            ticks = self._due[bus.tx_clock] <= time + _ROUNDING_S
            if ticks:
                self._due[bus.tx_clock] = math.inf
                self._binding.call("setClock", [bus.tx_clock], [True])
        else:
            (ticks,) = self._binding.call("getClock", [bus.tx_clock])
        if not ticks:
            return b""
        (content,) = self._binding.call("getBinary", [bus.tx_data])
        return content or b""

    def _count_down(self, time: float) -> None:
        for clock in self._due:
            reference = (fmi3.fmi3ValueReference * 1)(clock)
            interval, qualifier = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
            self._binding.call("getIntervalDecimal", reference, interval, qualifier)
            if qualifier[0] == _CHANGED:
                self._due[clock] = time + interval[0]

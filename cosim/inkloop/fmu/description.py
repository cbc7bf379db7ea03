"""The description of an FMU, in one form for FMI 2 and FMI 3."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import groupby
from pathlib import Path

from inkloop.component import Port
from inkloop.errors import FmuError, nearest
from inkloop.fmu.bus_terminals import BusTerminal
from inkloop.fmu.variable import Variable, summary

_ALIKE_MAX = 8
"""Scalars whose names differ in numbers, in rows of their own."""


@dataclass(frozen=True)
class FmuDescription:
    """An FMU as described by its modelDescription.xml.

    platforms: folders with binaries in the archive; unused: variables that the master does not exchange, and their
    kinds; notes: on reading it, one sentence each; is_single: a process takes one instance; needs_tool: it runs where
    the tool is installed that made it; buses: its bus terminals (FMI-LS-BUS); unserved: those that the master cannot
    serve, and why; needs_events: it has clocks, and Event Mode; is_bus_simulation: its buses
    are joined in it.
    """

    path: Path
    name: str
    fmi: int
    identifier: str
    token: str
    variables: Mapping[str, Variable]
    platforms: tuple[str, ...]
    can_serialize: bool
    can_vary_step: bool
    is_single: bool = False
    needs_tool: bool = False
    unused: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    buses: tuple[BusTerminal, ...] = ()
    unserved: Mapping[str, str] = field(default_factory=dict)
    needs_events: bool = False
    is_bus_simulation: bool = False
    description: str = ""
    version: str = ""
    license: str = ""
    tool: str = ""

    @property
    def parameters(self) -> dict[str, Variable]:
        """Variables that may be set before the first step, structural ones included."""
        return {name: variable for name, variable in self.variables.items() if variable.is_settable}

    @property
    def default_sizes(self) -> dict[str, int]:
        """Structural parameter that sizes arrays -> start value."""
        return {v.name: int(v.start[0]) for v in self.variables.values() if v.is_size and v.start}

    def sizes(self, structural: Mapping[str, int]) -> dict[str, int]:
        """The sizes of arrays with the values of `structural`. Raises FmuError if the FMU does not accept them."""
        sizes = self.default_sizes
        for name, size in structural.items():
            if name in sizes:
                sizes[name] = int(size)
            elif self.grid is None or name not in ("nx", "ny"):
                known = nearest(name, sizes) if sizes else "it has none"
                raise FmuError(f"{self.path}: {name} is no structural parameter of {self.name}; {known}")
        wanted = (structural.get("nx"), structural.get("ny"))
        if self.fixed_grid and None not in wanted and wanted != self.fixed_grid:
            nx, ny = wanted
            flag = "--fmi 2" if self.fmi == 2 else "--fmi 3 --fixed"
            raise FmuError(
                f"{self.path}: {self.name} has a fixed grid of {self.fixed_grid[0]} x {self.fixed_grid[1]} cells, "
                f"wanted are {nx} x {ny}; take the grid of the FMU, or make one that fits: "
                f"inkloop export fmu {self.name} {flag} --nx {nx} --ny {ny}"
            )
        return sizes

    @property
    def fixed_grid(self) -> tuple[int, int] | None:
        """(nx, ny) of one of our FMUs that has no other; a matrix of others may be anything, as of a rotation."""
        return self.grid if self.tool.startswith("inkloop ") and "nx" not in self.default_sizes else None

    @property
    def grid(self) -> tuple[int, int] | None:
        """(nx, ny) of the first map among inputs and outputs as delivered, None if there is no map."""
        sizes = self.default_sizes
        for port in (*self.ports("input", sizes), *self.ports("output", sizes)):
            if len(port.shape) == 2:
                return port.shape[0], port.shape[1]
        return None

    def ports(self, causality: str, sizes: Mapping[str, int]) -> tuple[Port, ...]:
        """Inputs or outputs in the order of the description."""
        return tuple(v.port(sizes) for v in self.variables.values() if v.causality == causality)

    def lines(self) -> Iterator[str]:
        """The description for a person."""
        yield f"{self.name}  FMI {self.fmi} co-simulation  {self.version}".rstrip()
        if self.description:
            yield f"  {self.description}"
        grid = "none" if self.grid is None else f"{self.grid[0]} x {self.grid[1]} cells"
        resizable = " (any size: structural parameters nx, ny)" if "nx" in self.default_sizes else ""
        yield f"  file       {self.path}"
        yield f"  grid       {grid}{resizable}"
        yield f"  platforms  {', '.join(self.platforms) or 'none (sources only)'}"
        yield f"  state      {'can be saved and restored' if self.can_serialize else 'cannot be saved'}"
        yield f"  step size  {'any' if self.can_vary_step else 'fixed'}"
        if self.is_single:
            yield "  instances  one in a process"
        if self.needs_tool:
            yield "  needs      the tool that made it, on this machine"
        for bus in self.buses:
            yield f"  bus        {bus.name}: CAN (FMI-LS-BUS), sends by a {bus.tx_interval} clock"
        for name, reason in self.unserved.items():
            yield f"  bus        {name}: {reason}"
        yield f"  licence    {self.license or 'not stated'}"
        yield f"  made by    {self.tool or 'not stated'}"
        for title, causalities in (
            ("inputs", ("input",)),
            ("outputs", ("output",)),
            ("parameters", ("structuralParameter", "parameter")),
        ):
            rows = dict(_rows(v for v in self.variables.values() if v.causality in causalities))
            yield f"{title}{'' if rows else ': none'}"
            width = max(map(len, rows), default=0)
            for name, about in rows.items():
                yield f"  {name:{width}}  {about}"
        if self.unused:
            yield "not exchanged (numbers and truth values are, texts as parameters, clocks and binaries of buses)"
            width = max(map(len, self.unused))
            for name, kind in self.unused.items():
                yield f"  {name:{width}}  {kind}"
        for note in self.notes:
            yield f"note: {note}"


def _rows(variables: Iterable[Variable]) -> Iterator[tuple[str, str]]:
    """The name and the summary of each variable; one row for those that differ in the numbers of their names alone."""
    for (_, about), alike in groupby(variables, lambda v: (re.sub(r"\d+", "0", v.name), summary(v))):
        names = [each.name for each in alike]
        if len(names) > _ALIKE_MAX:
            names = [f"{names[0]} to {names[-1]} ({len(names)})"]
        yield from ((name, about) for name in names)

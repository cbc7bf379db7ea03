"""Variables of a model: variables.toml as objects, and their value references."""

from __future__ import annotations

import hashlib
import math
import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from inkloop.errors import FmuError

EXPOSED = ("independent", "structural", "input", "output", "parameter")
HIDDEN = ("state", "scratch")
EMULATED_TYPES = ("real", "integer", "enumeration")
TYPES = ("real", "integer", "boolean", "enumeration", "count", "clock", "string", "binary")
WITHOUT_NUMBER = ("clock", "string", "binary")
"""Types only of scalars of FMI 3; the start value is a clock that does not tick, or empty."""


@dataclass(frozen=True)
class VariableDefinition:
    """One variable: a scalar, a map over the grid, or several maps.

    `along`: structural parameter that is the number of maps; None: one map. `initial_from`: variables that the start
    value is computed from; `declared`: the enumeration; `is_tunable`: the parameter may be set between steps.
    `emulated`: the member of the emulator's WorldOptions (world.h) that holds this parameter; None: the emulator has
    none. `clock`: the clock of a clocked variable; `mime_type`: of a binary; `max` of a string or binary: most bytes.
    `absent`, `unlimited`, `needs`, `scenario`: of the option in Python (inkloop_controller.problem.options),
    without meaning for an FMU.
    """

    name: str
    causality: str
    description: str = ""
    type: str = "real"
    shape: str = "scalar"
    along: str | None = None
    unit: str = "1"
    start: float = 0
    min: float | None = None
    max: float | None = None
    declared: str | None = None
    terminal: str | None = None
    initial_from: str | None = None
    is_tunable: bool = False
    emulated: str | None = None
    clock: str | None = None
    mime_type: str | None = None
    absent: str = ""
    unlimited: bool = False
    needs: str = ""
    scenario: str = ""

    @property
    def is_grid(self) -> bool:
        """True for a value per cell."""
        return self.shape == "grid"

    @property
    def dimensions(self) -> tuple[str, ...]:
        """The structural parameters that size the variable; none for a scalar."""
        if not self.is_grid:
            return ()
        return ("nx", "ny") if self.along is None else (self.along, "nx", "ny")

    def shape_for(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        """Lengths along its dimensions."""
        return tuple(sizes[name] for name in self.dimensions)

    def count(self, sizes: Mapping[str, int]) -> int:
        """Number of its values."""
        return math.prod(self.shape_for(sizes))

    @property
    def is_exposed(self) -> bool:
        """True for variables that importers see."""
        return self.causality in EXPOSED


@dataclass(frozen=True)
class EnumerationDefinition:
    """An enumeration: item name -> number."""

    description: str
    items: Mapping[str, int]


@dataclass(frozen=True)
class ModelDefinition:
    """A model: its variables in the order of the C table, and the other content of a description.

    terminals, buses: name -> description; a bus is a terminal of FMI-LS-BUS.
    """

    name: str
    description: str
    step_size: float
    stop_time: float
    variables: tuple[VariableDefinition, ...]
    types: Mapping[str, EnumerationDefinition] = field(default_factory=dict)
    terminals: Mapping[str, str] = field(default_factory=dict)
    buses: Mapping[str, str] = field(default_factory=dict)

    @property
    def has_events(self) -> bool:
        """True for a model with clocks, which needs Event Mode."""
        return any(v.type == "clock" for v in self.variables)

    @property
    def exposed(self) -> tuple[VariableDefinition, ...]:
        """The variables that importers see; they come first in the table."""
        return tuple(v for v in self.variables if v.is_exposed)

    @property
    def emulated(self) -> tuple[VariableDefinition, ...]:
        """The parameters that the emulator has under the same names."""
        return tuple(v for v in self.variables if v.emulated is not None)

    @property
    def fingerprint(self) -> str:
        """16 hexadecimal digits that change with every property that the binary must know."""
        known = [
            (v.name, c_causality(v), v.type, v.dimensions, v.start, *self.limits(v), *filter(None, (v.clock,)))
            for v in self.variables
        ]
        return hashlib.sha256(repr((self.name, known)).encode()).hexdigest()[:16]

    def sizes(self, given: Mapping[str, Any]) -> dict[str, int]:
        """The structural parameters, nx and ny first: the values given, else the start values."""
        return {v.name: int(given.get(v.name, v.start)) for v in self.variables if v.causality == "structural"}

    def token(self, sizes: Mapping[str, int], *, resizable: bool, mark: str = "") -> str:
        """GUID or instantiation token: the binary reads the sizes from it, so one binary serves every grid.

        mark: distinguishes FMUs of one grid whose resources differ, up to 14 characters.
        """
        end = "-resizable" if resizable else f"-{mark}" if mark else ""
        return f"{self.name}-{self.fingerprint}-{'x'.join(map(str, sizes.values()))}{end}"

    def limits(self, variable: VariableDefinition) -> tuple[float | None, float | None]:
        """Smallest and largest value, None where there is no limit."""
        if variable.type in ("boolean", "clock"):
            return 0, 1
        if variable.declared is None:
            return variable.min, variable.max
        numbers = self.types[variable.declared].items.values()
        return min(numbers), max(numbers)

    def scalar_references(self, sizes: Mapping[str, int]) -> Iterator[tuple[VariableDefinition, int]]:
        """Each exposed variable with the first of its references where every cell has one of its own (FMI 2)."""
        reference = 0
        for variable in self.exposed:
            yield variable, reference
            reference += variable.count(sizes)


def c_causality(variable: VariableDefinition) -> str:
    """The causality as the binary distinguishes it: tunable parameters are a separate one."""
    return "tunable" if variable.is_tunable else variable.causality


def text_of(path: Path) -> str:
    """The text of a variables.toml; its row `model = "emulated"` becomes the emulated parameters of the model in the
    folder of that name, without those that it has itself.
    """
    text = path.read_text("utf-8")
    own = set(re.findall(r"^(\w+) = ", text, re.MULTILINE))

    def rows(match: re.Match[str]) -> str:
        lines = (path.parent.with_name(match[1]) / path.name).read_text("utf-8").splitlines()
        return "\n".join(line for line in lines if ", emulated = " in line and line.partition(" ")[0] not in own)

    return re.sub(r'^(\w+) = "emulated"$', rows, text, flags=re.MULTILINE)


def load(text: str, source: str | Path) -> ModelDefinition:
    """Read the text of a variables.toml. Raises FmuError with every error."""
    try:
        table = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FmuError(f"{source}: is not TOML: {error}") from error
    types = {name: EnumerationDefinition(**entry) for name, entry in table.get("types", {}).items()}
    variables = tuple(VariableDefinition(name, **entry) for name, entry in table["variables"].items())
    errors = list(_errors(variables, table))
    if errors:
        raise FmuError("\n".join([f"{source}: {len(errors)} errors", *(f"  - {error}" for error in errors)]))
    return ModelDefinition(
        name=table["model"],
        description=table["description"],
        step_size=table["step_size"],
        stop_time=table["stop_time"],
        variables=variables,
        types=types,
        terminals=table.get("terminals", {}),
        buses=table.get("buses", {}),
    )


def _errors(variables: tuple[VariableDefinition, ...], table: Mapping[str, Any]) -> Iterator[str]:
    names = {v.name for v in variables}
    ranks = [(*EXPOSED, *HIDDEN).index(v.causality) for v in variables if v.causality in (*EXPOSED, *HIDDEN)]
    if len(ranks) < len(variables):
        yield f"a causality is none of {', '.join((*EXPOSED, *HIDDEN))}"
    if ranks != sorted(ranks):
        yield f"variables must come in the order {', '.join((*EXPOSED, *HIDDEN))}"
    if [v.name for v in variables[:3]] != ["time", "nx", "ny"]:
        yield "the first variables must be time, nx, ny"
    structural = [v.name for v in variables if v.causality == "structural"]
    if len(structural) > 3:
        yield f"structural parameters are {', '.join(structural)}; at most one comes after nx, ny"
    for v in variables:
        if v.along is not None and (not v.is_grid or v.along not in structural[2:]):
            yield f"{v.name}: along is {v.along!r}; a grid may name a structural parameter after nx, ny"
        if v.is_tunable and v.causality != "parameter":
            yield f"{v.name}: is_tunable is true; only a parameter can be"
        if v.emulated is not None and (v.causality != "parameter" or v.is_grid or v.type not in EMULATED_TYPES):
            yield f"{v.name}: is emulated; only a scalar parameter of type {', '.join(EMULATED_TYPES)} can be"
        if v.type not in TYPES:
            yield f"{v.name}: type is {v.type!r}; expected one of {', '.join(TYPES)}"
        if v.is_exposed and not v.description:
            yield f"{v.name}: has no description"
        if (v.type == "enumeration") != (v.declared in table.get("types", {})):
            yield f"{v.name}: declared is {v.declared!r}; an enumeration names one of [types], others none"
        if v.terminal is not None and v.terminal not in {**table.get("terminals", {}), **table.get("buses", {})}:
            yield f"{v.name}: terminal is {v.terminal!r}; it is not in [terminals] or [buses]"
        if v.type in WITHOUT_NUMBER and (v.is_grid or v.start != 0):
            yield f"{v.name}: is a {v.type}; it is one value without a start value"
        if v.type in ("string", "binary") and v.max is None:
            yield f"{v.name}: is a {v.type} without max, its most bytes"
        if v.clock is not None and v.clock not in {each.name for each in variables if each.type == "clock"}:
            yield f"{v.name}: clock is {v.clock!r}; there is no such clock"
        if v.initial_from is not None and v.initial_from not in names:
            yield f"{v.name}: initial_from is {v.initial_from!r}; there is no such variable"

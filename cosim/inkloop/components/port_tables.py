"""`[components.NAME.ports]`: map variables of an FMU to ports, with unit, gain and offset.

A variable is named as the FMU names it, `"H"` also for the structured scalars `H[1,1]`, `H[1,2]`, ... of FMI 2. Scalars
of any other spelling are named by a template: `"z_{i}_{j}"`, or `"z{n}"` where they are counted through; `{i:02}` is
01.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from inkloop.component import Job, Port
from inkloop.component_errors import repeated
from inkloop.components.port_mapping import MappedPort
from inkloop.contract import SIGNALS
from inkloop.errors import nearest
from inkloop.master.orientation import Mirrored, Orientation, Transposed
from inkloop.tables.messages import sentence
from inkloop.units import UNITS, Conversion, conversion, is_defined, si_unit, unit_conversion

OPTION = "ports"
_PLACE = re.compile(r"\{(?P<index>[ijn])(?::0(?P<width>\d))?\}")
_Finite = Annotated[float, Field(allow_inf_nan=False)]


class PortTable(BaseModel):
    """One port: the FMU's own number is gain * (value in `unit`) + offset."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, defer_build=True)
    variable: str = Field(description="its name in the FMU, or a template with `{i}`, `{j}` or `{n}`; `{i:02}` is 01")
    unit: str | None = Field(
        default=None, description="of the numbers in the FMU; none: the unit that the FMU declares"
    )
    gain: _Finite = Field(default=1.0, description="number in the FMU per `unit`")
    offset: _Finite = Field(default=0.0, description="number in the FMU at zero")
    first: int = Field(default=1, ge=0, description="first index of a template")
    mirror: Mirrored = "none"
    transpose: Transposed = False

    @property
    def orientation(self) -> Orientation:
        """Of the maps in the FMU."""
        return Orientation(self.mirror, self.transpose)


def mapped_ports(
    fmu_inputs: Sequence[Port], fmu_outputs: Sequence[Port], job: Job, option: object
) -> tuple[list[MappedPort], list[MappedPort], list[str]]:
    """Mapped inputs, mapped outputs, and everything wrong with the option, one sentence each.

    A signal of the layer contract that the FMU has in another unit of its quantity (a height in mm) is mapped too.
    """
    if not isinstance(option, Mapping):
        return [], [], [f'{OPTION} is {option!r}; expected a table, such as {OPTION}.height = "H"']
    inputs: list[MappedPort] = []
    outputs: list[MappedPort] = []
    errors: list[str] = []
    own = {"input": {port.name: port for port in fmu_inputs}, "output": {port.name: port for port in fmu_outputs}}
    for name, found in {**_in_other_units(own, option), **option}.items():
        if not isinstance(found, str | Mapping):
            errors.append(f"{OPTION}.{name} is {found!r}; expected the name of a variable, or a table with it")
            continue
        try:
            table = PortTable.model_validate({"variable": found} if isinstance(found, str) else found)
        except ValidationError as error:
            errors += [f"{OPTION}.{name}.{sentence(detail, PortTable)}" for detail in error.errors()]
            continue
        way = "input" if _names(table, job)[0] in own["input"] else "output"
        mapped, wrong = _mapped(str(name), table, job, own[way], {*own["input"], *own["output"]})
        errors += [f"{OPTION}.{name}{error}" for error in wrong]
        if mapped is not None:
            (inputs if way == "input" else outputs).append(mapped)
    return inputs, outputs, errors + _taken_twice(inputs, outputs, own)


def _in_other_units(own: Mapping[str, Mapping[str, Port]], option: Mapping[str, object]) -> dict[str, str]:
    """Signals of the contract by the name of their variable that the option does not use, in a unit to convert."""
    used = {found.get("variable") if isinstance(found, Mapping) else found for found in option.values()}
    return {
        name: name
        for ports in own.values()
        for name, port in ports.items()
        if name in SIGNALS and name not in used and conversion(port.unit, SIGNALS[name].unit) not in (None, 1.0)
    }


def _names(table: PortTable, job: Job) -> list[str]:
    """The variables of the FMU in the order of the cells."""
    if not _PLACE.search(table.variable):
        return [table.variable]
    rows, columns = table.orientation.shape((job.nx, job.ny))
    cells = [(i, j) for i in range(rows) for j in range(columns)]
    return [_filled(table.variable, table.first, {"i": i, "j": j, "n": n}) for n, (i, j) in enumerate(cells)]


def _filled(template: str, first: int, at: Mapping[str, int]) -> str:
    return _PLACE.sub(lambda place: str(first + at[place["index"]]).zfill(int(place["width"] or 0)), template)


def _mapped(
    name: str, table: PortTable, job: Job, own: Mapping[str, Port], known: set[str]
) -> tuple[MappedPort | None, list[str]]:
    names = _names(table, job)
    if missing := [variable for variable in names if variable not in own]:
        what = f" is {table.variable!r}" + (f", so {missing[0]!r}" if missing[0] != table.variable else "")
        whole = missing[0].partition("[")[0]
        advice = f"its scalars are joined, write {whole!r}" if whole in known else nearest(missing[0], known)
        return None, [f".variable{what}, which is no input or output of the FMU; {advice}"]
    if len(set(names)) < len(names):
        advice = "write both {i} and {j}, or {n}"
        return None, [f".variable is {table.variable!r}, one name for several of {job.nx} x {job.ny} cells; {advice}"]
    variables = [own[variable] for variable in names]
    port = _port(name, table, job, variables)
    found, needed = (sum(math.prod(each.shape) for each in ports) for ports in (variables, [port]))
    if found != needed:
        of_grid = f"{job.nx} x {job.ny} values, as the grid; take the grid of the FMU, or make one that fits"
        what = of_grid if port.shape else "one value"
        return None, [f".variable is {table.variable!r} with {found} values; needs {what}"]
    if errors := [*_orientation_errors(table, variables, port), *_unit_errors(table, variables[0], port.unit)]:
        return None, errors
    units = unit_conversion(port.unit, table.unit or variables[0].unit) or Conversion(1.0)  # counts have a gain only
    factor, offset = table.gain * units.factor, table.gain * units.offset + table.offset
    is_real = np.dtype(variables[0].dtype).kind == "f"
    if (factor != 1.0 or offset != 0.0) and not is_real:
        found_type = variables[0].dtype
        return None, [f".variable is {table.variable!r} of type {found_type}; a unit, gain or offset needs a real one"]
    mapped = MappedPort(port, variables, factor, offset, table.orientation)
    return (mapped if name in SIGNALS else replace(mapped, port=replace(port, start=mapped.start()))), []


def _port(name: str, table: PortTable, job: Job, variables: Sequence[Port]) -> Port:
    """The port of a signal: of the layer contract as defined there; of any other by its variables, in SI."""
    first, grid = variables[0], (job.nx, job.ny)
    if name in SIGNALS:
        return SIGNALS[name].port(grid)
    unit, _ = si_unit(table.unit or first.unit)
    return Port(name, unit, grid if len(variables) > 1 else table.orientation.shape(first.shape), first.dtype)


def _orientation_errors(table: PortTable, variables: Sequence[Port], port: Port) -> list[str]:
    """The error of a map in another order of axes, and of an orientation for what is no map."""
    if len(port.shape) != 2:
        what = "transpose" if table.transpose else "mirror"
        return [] if table.orientation.is_own else [f".{what} turns maps, and {port.name} is none; leave it out"]
    there, expected = variables[0].shape, table.orientation.shape(port.shape)
    if len(variables) > 1 or len(there) != 2 or there == expected:
        return []
    found, needed = (" x ".join(map(str, shape)) for shape in (there, expected))
    advice = "write transpose = true if its first index goes along y" if there == expected[::-1] else "take its grid"
    return [f".variable is {table.variable!r} of {found}; needs {needed}: {advice}"]


def _unit_errors(table: PortTable, variable: Port, unit: str) -> list[str]:
    """The error in the unit of a port in `unit`; with a gain any unit of the FMU is accepted."""
    if table.gain == 0.0:
        return [".gain is 0; needs another number, or nothing gets through"]
    if unit == "1":
        what = f".unit is {table.unit!r}, but this signal is a number without unit; leave it out, use gain instead"
        return [what] if table.unit not in (None, "1") else []
    if table.unit is None and unit_conversion(unit, variable.unit) is None:
        return [f".variable is {table.variable!r} in [{variable.unit}]; {_units_of(unit)}, and a gain if it takes one"]
    if table.unit is not None and unit_conversion(unit, table.unit) is None:
        return [f".unit is {table.unit!r}; {_units_of(unit)}"]
    if table.unit not in (None, variable.unit) and is_defined(variable.unit) and table.gain == 1.0:
        return [f".unit is {table.unit!r}, but the FMU declares {variable.name} in [{variable.unit}]; leave it out"]
    return []


def _units_of(unit: str) -> str:
    names = ", ".join(name for name, (si, _) in UNITS.items() if si == unit)
    return f"needs a unit of the quantity [{unit}]: write unit, one of {names}"


def _taken_twice(
    inputs: Sequence[MappedPort], outputs: Sequence[MappedPort], own: Mapping[str, Mapping[str, Any]]
) -> list[str]:
    errors = []
    for mapped, ports in ((inputs, own["input"]), (outputs, own["output"])):
        taken = [variable.name for each in mapped for variable in each.variables]
        errors += [f"{OPTION}: {name} stands behind two ports; keep one" for name in repeated(taken)]
        clash = sorted({each.port.name for each in mapped} & (ports.keys() - set(taken)))
        errors += [f"{OPTION}.{name}: the FMU also has a variable of that name; map it to another" for name in clash]
    return errors

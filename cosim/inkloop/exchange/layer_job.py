"""Write LayerJob.fmu: collect its content from a scenario, report everything it cannot hold, and write the file.

Its parameters are in resources/job.bin, those of an exported bench in a file like it.
"""

from __future__ import annotations

import argparse
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inkloop import __version__, contract
from inkloop.component import Job
from inkloop.components import catalog
from inkloop.errors import ScenarioError, missing
from inkloop.exchange.ssp.system import CONTROLLER, PYTHON_CONTROLLER, Part, System, Wire, system_of
from inkloop.files import temporary_folder
from inkloop.fmu_writer.archive import definition_in, described, pack, read_definition, unpack
from inkloop.fmu_writer.definition import ModelDefinition
from inkloop.fmu_writer.description import Baked
from inkloop.fmu_writer.documentation import with_section
from inkloop.fmu_writer.export import INTERVALS, find_fmu, job_template, with_platforms
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M

FORMS: Mapping[str, str] = {"2": "fmi2", "3": "fmi3-fixed"}
"""Version of FMI -> form of our FMUs that the block comes in; without arrays there is nothing to resize."""
JOB = "resources/job.bin"
MAGIC, LAYOUT = b"InkJob\r\n", 1
SCENARIO = "documentation/scenario.toml"
PICTURE = "documentation/target.png"
INDEX = "documentation/index.html"
ROLES: Mapping[str, tuple[str, ...]] = {
    contract.PRINTER: catalog.DEPOSITION_MODELS,
    contract.PROFILER: ("ProfileSensor",),
    contract.CONTROLLER: (CONTROLLER,),
}
"""The parts of a job, in the order of its file, and the models that can be each of them."""
CONTRACT = frozenset(
    (signal.giver, taker, signal.name) for signal in contract.SIGNALS.values() for taker in signal.takers
)
"""(source, target, signal) as the block wires its parts."""


@dataclass(frozen=True, eq=False)
class Bake:
    """Content of a block. parts: by role its model and parameters; own: start values of the block's parameters.

    intervals: most height intervals of the region of ink A on a cell.
    """

    title: str
    scenario_text: str
    job: Job
    parts: Mapping[str, tuple[str, Mapping[str, NDArray[Any]]]]
    own: Mapping[str, float]
    stop_s: float
    intervals: int


def bake(scenario: Scenario) -> Bake:
    """The parameters that `inkloop export ssp` writes too. Raises ScenarioError with every obstacle, FmuError."""
    with temporary_folder("job") as folder:
        system = system_of(scenario, "3", Path(folder))
    roles = _roles(system)
    if obstacles := list(_obstacles(scenario, system, roles)):
        raise ScenarioError(scenario.source, obstacles)
    parts = {role: system.part(name) for name, role in roles.items()}
    values = {role: (parts[role].description.name, dict(parts[role].values)) for role in ROLES}
    durations = {
        "layer_duration": _value(parts[contract.PRINTER], "layer_duration"),
        "scan_duration": _value(parts[contract.PROFILER], "scan_duration"),
    }
    own = {
        "layer_period": max(scenario.tables.run.step_s, sum(durations.values())),
        **durations,
        "layers_max": scenario.tables.run.layers_max,
        **{name: _value(parts[contract.CONTROLLER], name) for name in ("alpha", "time_limit")},
    }
    intervals = int(_value(parts[contract.CONTROLLER], INTERVALS))
    return Bake(scenario.tables.title, scenario.text, scenario.job(), values, own, system.stop_s, intervals)


def _roles(system: System) -> dict[str, str]:
    """Role by component, where its model has one."""
    models = {model: role for role, models in ROLES.items() for model in models}
    return {part.name: models[part.description.name] for part in system.parts if part.description.name in models}


def _obstacles(scenario: Scenario, system: System, roles: Mapping[str, str]) -> Iterator[str]:
    ours = (PYTHON_CONTROLLER, *catalog.FMU_MODELS)
    strange = {name: table.kind for name, table in scenario.tables.components.items() if table.kind not in ours}
    for name in {**strange, **system.outside}:
        reason = system.outside.get(name, f"kind {strange.get(name)} is an FMU of its own")
        yield f"components.{name}: {reason}; a block is made of {', '.join(ours)}"
    for role, models in ROLES.items():
        names = [name for name, found in roles.items() if found == role]
        if len(names) > 1:
            yield f"{' and '.join(names)} are each a {role}; a block has one: keep one"
        elif not names and not strange and not system.outside:
            yield f"no component is the {role} of the block; add one of kind {' or '.join(models)}"
    if system.has_events:
        yield "[[events]] are changes that a block knows nothing of; take them out, and let the importer change inputs"
    yield from _wiring_obstacles(system.wires, roles)


def _wiring_obstacles(wires: Sequence[Wire], roles: Mapping[str, str]) -> Iterator[str]:
    for wire in wires:
        (source, output), (target, port) = wire.source, wire.target
        if source not in roles or target not in roles:
            continue
        place = f"connections: {source}.{output} to {target}.{port}"
        if output != port or (roles[source], roles[target], port) not in CONTRACT:
            yield f"{place} is none of the layer contract, by which a block wires its parts; take it out"
        elif wire.gain != 1.0 or wire.offset != 0.0:
            yield f"{place} has a gain or an offset, and a block wires its parts without; take it out"


def _value(part: Part, name: str) -> float:
    """A scalar parameter of a part, in SI."""
    return float(part.values[name] if name in part.values else part.variable(name).start[0])


def write(
    bake: Bake, fmi: Literal["2", "3"], out: Path, *, platforms: Sequence[str] | None = None, picture: bool = True
) -> None:
    """Write the FMU whole or not at all; platforms: as in `export_fmu`; picture: of the target. Raises FmuError."""
    form, job = FORMS[fmi], bake.job
    members = unpack(job_template(form))
    model = definition_in(members)
    content = to_bytes(job.nx, job.ny, _sections(model, bake))
    sizes = {"nx": job.nx, "ny": job.ny, INTERVALS: bake.intervals}
    starts = {**bake.own, **sizes}
    begun = replace(model, variables=tuple(replace(v, start=starts.get(v.name, v.start)) for v in model.variables))
    members |= {
        JOB: content,
        SCENARIO: bake.scenario_text.encode(),
        INDEX: with_section(members[INDEX], _section(bake, picture), begun),
    }
    if picture:
        from inkloop.exchange.job_picture import target_picture

        members[PICTURE] = target_picture(job, bake.title)
    baked = Baked(
        starts=bake.own,
        mark=check_sum(content),
        description=f"{bake.title}: {model.description}",
        step_size=bake.own["layer_period"],
        stop_time=bake.stop_s,
    )
    members = described(members, form, sizes, __version__, baked)
    if platforms is not None:
        members = with_platforms(members, fmi, platforms)
    out.parent.mkdir(parents=True, exist_ok=True)
    pack(out, members)


def _sections(model: ModelDefinition, bake: Bake) -> list[Section]:
    own = Section(model, {name: np.asarray(value) for name, value in bake.own.items()})
    return [own, *(Section(read_definition(find_fmu(name)), values) for name, values in bake.parts.values())]


def _section(bake: Bake, picture: bool) -> str:
    """Readable description of the embedded job."""
    job = bake.job
    lines = [
        "<h2>What this block prints</h2>",
        f"<p>{escape(bake.title)}: {job.nx} x {job.ny} cells of {job.pitch * UM_PER_M:g} µm, {int(job.mask.sum())} "
        f"of them printed, up to {job.target_height.max() * UM_PER_M:g} µm high. The scenario as it was exported: "
        f'<a href="{Path(SCENARIO).name}">{Path(SCENARIO).name}</a>.</p>',
        *([f'<p><img src="{Path(PICTURE).name}" alt="target" width="700"></p>'] if picture else []),
        "<table><tr><th>part</th><th>model</th><th>parameter</th><th>value, SI</th></tr>",
    ]
    for role, (model, values) in bake.parts.items():
        for name, value in sorted(values.items()):
            cells = (role, model, name, _shown(value))
            lines.append("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>")
    return "\n".join([*lines, "</table>", "<p>All other parameters of the parts have their start values.</p>", ""])


def _shown(value: NDArray[Any]) -> str:
    if value.ndim == 0:
        return str(value.item())
    return f"{' x '.join(map(str, value.shape))} values, {value.min()} to {value.max()}"


def export(scenario: Scenario, options: argparse.Namespace, console: Terminal) -> int:
    """Write the file and describe it; returns the exit code. Raises ScenarioError, FmuError."""
    baked = bake(scenario)
    out = options.out or Path(f"{Path(scenario.source).stem}.fmu")
    without_picture = missing("matplotlib", "the picture of the target")
    write(baked, options.fmi, out, platforms=options.platforms, picture=not without_picture)
    models = ", ".join(model for model, _ in baked.parts.values())
    console.sentence(f"wrote {out}: {models} in one block, a layer each {baked.own['layer_period']:g} s")
    if without_picture:
        console.sentence(f"  left out of it: {without_picture}")
    if scenario.tables.run.time_max_s is not None:
        console.sentence("  time_max_s is not in it: the importer decides when it stops")
    console.result(file=out)
    return 0


@dataclass(frozen=True, eq=False)
class Section:
    """The parameters of one model that are not its start values: in SI, maps (nx, ny), enumerations as numbers.

    A string is its bytes.
    """

    model: ModelDefinition
    values: Mapping[str, NDArray[Any]]


def to_bytes(nx: int, ny: int, sections: Sequence[Section]) -> bytes:
    """The content of such a file, as fmus/common/parameter_file.c reads it: all numbers little-endian."""
    checked = struct.pack("<QQ", nx, ny) + b"".join(_section_bytes(section) for section in sections)
    return MAGIC + struct.pack("<II", LAYOUT, zlib.crc32(checked)) + checked


def check_sum(content: bytes) -> str:
    """Identifies this file, 8 hexadecimal digits; the token of its FMU ends with it."""
    return f"{struct.unpack_from('<I', content, 12)[0]:08x}"


def _section_bytes(section: Section) -> bytes:
    numbers = {variable.name: number for number, variable in enumerate(section.model.variables)}
    head = struct.pack("<32s16sQ", section.model.name.encode(), section.model.fingerprint.encode(), len(section.values))
    return head + b"".join(_parameter(numbers[name], value) for name, value in section.values.items())


def _parameter(number: int, value: NDArray[Any]) -> bytes:
    return struct.pack("<QQ", number, value.size) + np.ascontiguousarray(value, "<f8").tobytes()

"""Write LayerJob.fmu: its parameters (resources/job.bin), description and documentation."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from inkloop import __version__
from inkloop.errors import missing
from inkloop.exchange.job.baking import Bake, bake
from inkloop.exchange.parameter_file import Section, check_sum, to_bytes
from inkloop.fmu_writer.archive import definition_in, described, pack, read_definition, unpack
from inkloop.fmu_writer.cross import with_platforms
from inkloop.fmu_writer.definition import ModelDefinition
from inkloop.fmu_writer.description import Baked
from inkloop.fmu_writer.documentation import with_section
from inkloop.fmu_writer.export import INTERVALS, find_fmu, job_template
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M

FORMS: Mapping[str, str] = {"2": "fmi2", "3": "fmi3-fixed"}
"""Version of FMI -> form of our FMUs that the block comes in; without arrays there is nothing to resize."""
JOB = "resources/job.bin"
SCENARIO = "documentation/scenario.toml"
PICTURE = "documentation/target.png"
INDEX = "documentation/index.html"


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
        from inkloop.exchange.job.target_picture import target_picture

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

"""The bench of a scenario as an FMU on a CAN bus (FMI-LS-BUS): `inkloop export bench`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from inkloop import __version__
from inkloop.bench.commands import emulation_of
from inkloop.exchange.layer_job import Section, check_sum, to_bytes
from inkloop.fmu_writer.archive import definition_in, described, pack, unpack
from inkloop.fmu_writer.description import Baked
from inkloop.fmu_writer.export import find_fmu, with_platforms
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario

MODEL, FORM = "BenchBus", "fmi3-fixed"
PARAMETERS = "resources/bench.bin"
SCENARIO = "documentation/scenario.toml"


def export(scenario: Scenario, options: argparse.Namespace, console: Terminal) -> int:
    """Write the FMU whole or not at all; returns the exit code. Raises ScenarioError, FmuError."""
    emulation = emulation_of(scenario)
    members = unpack(find_fmu(MODEL, FORM))
    model = definition_in(members)
    faults = "; ".join(map(str, emulation.faults))
    starts: dict[str, float | Sequence[float]] = {**emulation.parameters}
    sizes = {name: int(emulation.parameters[name]) for name in ("nx", "ny")}
    for name in sizes:
        del starts[name]
    if emulation.surface is not None:
        starts["height_start"] = emulation.surface.ravel().tolist()
    values = {name: np.asarray(value) for name, value in starts.items()}
    values["faults"] = np.frombuffer(faults.encode(), np.uint8)
    content = to_bytes(sizes["nx"], sizes["ny"], [Section(model, values)])
    members |= {PARAMETERS: content, SCENARIO: scenario.text.encode()}
    baked = Baked(
        starts=starts,
        texts={"faults": faults},
        mark=check_sum(content),
        description=f"{scenario.tables.title}: {model.description}",
    )
    members = described(members, FORM, sizes, __version__, baked)
    if options.platforms is not None:
        members = with_platforms(members, "3", options.platforms)
    out = options.out or Path(f"{Path(scenario.source).stem}-bench.fmu")
    out.parent.mkdir(parents=True, exist_ok=True)
    pack(out, members)
    size = " x ".join(map(str, sizes.values()))
    console.sentence(f"wrote {out}: four nodes on one bus, {size} cells, ink and sensor of the scenario")
    console.result(file=out)
    return 0

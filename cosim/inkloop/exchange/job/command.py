"""`inkloop export-job`: a scenario as one block with scalar inputs and outputs."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from inkloop.exchange.job import archive
from inkloop.exchange.job.baking import bake
from inkloop.scenario.file import Scenario


def export(scenario: Scenario, options: argparse.Namespace, console: Console) -> int:
    """Write the file and describe it; returns the exit code. Raises ScenarioError, FmuError."""
    baked = bake(scenario)
    out = options.out or Path(f"{Path(scenario.source).stem}.fmu")
    archive.write(baked, options.fmi, out, windows=options.windows)
    models = ", ".join(model for model, _ in baked.parts.values())
    console.print(f"wrote {out}: {models} in one block, a layer each {baked.own['layer_period']:g} s", highlight=False)
    if scenario.tables.run.time_max_s is not None:
        console.print("  time_max_s is not in it: the importer decides when it stops", highlight=False)
    return 0

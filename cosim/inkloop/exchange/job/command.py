"""`inkloop export job`: a scenario as one block with scalar inputs and outputs."""

from __future__ import annotations

import argparse
from pathlib import Path

from inkloop.errors import missing
from inkloop.exchange.job import archive
from inkloop.exchange.job.baking import bake
from inkloop.report.terminal import Terminal
from inkloop.scenario.file import Scenario


def export(scenario: Scenario, options: argparse.Namespace, console: Terminal) -> int:
    """Write the file and describe it; returns the exit code. Raises ScenarioError, FmuError."""
    baked = bake(scenario)
    out = options.out or Path(f"{Path(scenario.source).stem}.fmu")
    without_picture = missing("matplotlib", "the picture of the target")
    archive.write(baked, options.fmi, out, platforms=options.platforms, picture=not without_picture)
    models = ", ".join(model for model, _ in baked.parts.values())
    console.sentence(f"wrote {out}: {models} in one block, a layer each {baked.own['layer_period']:g} s")
    if without_picture:
        console.sentence(f"  left out of it: {without_picture}")
    if scenario.tables.run.time_max_s is not None:
        console.sentence("  time_max_s is not in it: the importer decides when it stops")
    console.result(file=out)
    return 0

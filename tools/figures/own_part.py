"""The bracket of the tutorial: what `inkloop geometry` says of it, its picture, and its prints."""

from __future__ import annotations

from typing import Any

import numpy as np
from tools.figures.pages import DOCS, ROOT, Texts, block, read_json, table, write_json

from inkloop.printing.run import print_part
from inkloop.report import part_picture
from inkloop.report.formats import PNG
from inkloop.report.part_report import MeshReport, PartReport
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.scenario.part_file import mesh_of_scenario
from inkloop.units import UM_PER_M

PAGE = DOCS / "tutorial" / "print-your-own-part.md"
PICTURE = PAGE.with_name("own-part.png")
RECORD = PAGE.with_name("own-part.json")
SCENARIO = ROOT / "scenarios" / "bracket.toml"
FIGURES = ("misplaced_percent", "mean_error_um", "mae_um", "std_um")


def run() -> None:
    """Print the bracket with and without feedback, and draw it before it is printed."""
    scenario = Scenario.load(SCENARIO)
    others = {name: print_part(scenario.variant(name)) for name in scenario.tables.compare}
    runs = {scenario.tables.label: print_part(scenario), **others}
    write_json(RECORD, {label: measured(result) for label, result in runs.items()})
    part_picture.draw(PartReport.of(scenario, None), SCENARIO.name, PICTURE, [PNG])


def measured(result: Result) -> dict[str, Any]:
    """Errors of the top [um], and misplaced volume as a share of the part [%], over all cells of the grid."""
    target, height = result.dataset.target_height.values, result.final_height.values
    misplaced = float(np.abs(height - target).sum() / target.sum())
    metrics = result.metrics()
    errors = {f"{key}_um": round(metrics[key] * UM_PER_M, 3) for key in ("mean_error", "mae", "std")}
    return {"misplaced_percent": round(100.0 * misplaced, 3), **errors, "layers": int(metrics["layers"])}


def texts() -> Texts:
    """The report of the part as the code writes it, and the table from the record."""
    scenario, bodies = Scenario.load(SCENARIO), mesh_of_scenario(SCENARIO)
    assert bodies is not None
    lines = [*MeshReport.of(bodies).lines(), *PartReport.of(scenario, None).lines()]
    heads = ["run", "misplaced volume", "mean error", "mae", "std", "layers"]
    rows = [
        [
            label,
            f"{each['misplaced_percent']:.1f} %",
            *(f"{each[key]:z.2f}" for key in FIGURES[1:]),
            f"{each['layers']}",
        ]
        for label, each in read_json(RECORD).items()
    ]
    return {PAGE: {"bracket": block(["", *(f"    {line}" for line in lines)]), "bracket printed": table(heads, rows)}}

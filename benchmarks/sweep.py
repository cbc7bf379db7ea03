"""What a study costs besides its prints: processor time of the process that hands them out and keeps their records."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from rich.table import Table

from inkloop.units import MS_PER_S
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.engine import carry_out
from inkloop_lab.sweep.journal import RUNS_FOLDER, Journal
from inkloop_lab.sweep.local import LocalProcesses
from inkloop_lab.sweep.plan import PointsPlan
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Order, Record

SCENARIO = Path(__file__).parents[1] / "scenarios" / "cuboid.toml"
PRINTS, WORKERS = 60, 2
LIMIT_MS = 20.0
CASES = {"records only": 'maps = "none"', "last surfaces": 'maps = "final"', "layers while printing": "layers = true"}
TEXT = """
scenario = "{scenario}"
[vary]
"components.controller.horizon" = [1]
"components.controller.annealing_sweeps" = [1]
[seeds]
count = {prints}
[keep]
{keep}
"""


def measure() -> Table:
    """Processor time of the parent per print, with and without what a study keeps; the limit counts for each."""
    table = Table(title=f"processor time of a study's parent per print, {PRINTS} small prints on {WORKERS} processes")
    for heading in ("kept of a print", "parent", "limit", "kept?", "wall time of a print"):
        table.add_column(heading, justify="left" if heading == "kept of a print" else "right")
    for name, keep in CASES.items():
        parent_s, wall_s = _study(keep)
        is_kept = "yes" if MS_PER_S * parent_s <= LIMIT_MS else "NO"
        table.add_row(name, f"{MS_PER_S * parent_s:.1f} ms", f"{LIMIT_MS:g} ms", is_kept, f"{MS_PER_S * wall_s:.0f} ms")
    return table


def _study(keep: str) -> tuple[float, float]:
    """Processor time of this process and wall time, each per print [s]."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = folder / "study.toml"
        path.write_text(TEXT.format(scenario=SCENARIO, prints=PRINTS, keep=keep), encoding="utf-8")
        study = Study.load(path)
        runs = str(folder / RUNS_FOLDER) if "layers" in keep else None
        order = Order(study.scenario.text, str(SCENARIO), runs, "final" in keep)
        seen: list[Record] = []
        bundle = Bundle.of(study.scenario.text, SCENARIO)
        with LocalProcesses(WORKERS, order) as engine, Journal(folder, study, bundle) as journal:
            processor_s, wall_s = time.process_time(), time.monotonic()
            carry_out(PointsPlan(study), engine, journal, lambda: False, seen.append)
            taken_s, passed_s = time.process_time() - processor_s, time.monotonic() - wall_s
        if wrong := {record.error for record in seen if record.error}:
            raise RuntimeError(f"prints failed: {wrong}")
    return taken_s / PRINTS, passed_s / PRINTS

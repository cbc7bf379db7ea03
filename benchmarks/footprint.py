"""Peak memory and disk of whole prints beside the estimate by which a scenario is refused, for each cell."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from rich.progress import track
from rich.table import Table

from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

SIDES = (600, 1200)
"""Cells along an edge; figures are slopes between the two, so that what every print takes does not count."""
PITCH_UM, LAYER_UM = 100.0, 7.6
CASES = (
    ("LayerDeposition", "OpenLoop", {}, 2),
    ("LayerDeposition", "OpenLoop", {}, 8),
    ("LayerDeposition", "LayerMpc", {"horizon": 1}, 2),
    ("LayerDeposition", "LayerController", {"horizon": 1}, 2),
    ("VolumeAreaDeposition", "OpenLoop", {}, 2),
    ("SuperpositionDeposition", "OpenLoop", {}, 2),
    ("YoungLaplaceDeposition", "OpenLoop", {}, 2),
)
"""Printer, controller and its options, layers."""
KIBIBYTE = 1024


def measure() -> Table:
    """Bytes for each cell, each print in a process of its own; disk: the run folder at its end, without pictures."""
    table = Table(title=f"a print of {SIDES[0]} x {SIDES[0]} to {SIDES[1]} x {SIDES[1]} cells, bytes for each cell")
    for heading in ("printer", "controller", "layers", "memory", "estimate", "disk at the end", "estimate at most"):
        table.add_column(heading, justify="left" if heading in ("printer", "controller") else "right")
    for case in track(CASES, "footprint", transient=True):
        small, large = (_in_a_process(case, side) for side in SIDES)
        cells = SIDES[1] ** 2 - SIDES[0] ** 2
        memory, disk = ((large[name] - small[name]) / cells for name in ("memory", "disk"))
        estimate = _scenario(case, SIDES[0]).footprint
        row = (memory, estimate.memory_of_a_cell, disk, estimate.disk_of_a_cell)
        table.add_row(case[0], case[1], str(case[3]), *(f"{number:.0f}" for number in row))
    return table


def _scenario(case: tuple[str, str, dict[str, int], int], side: int) -> Scenario:
    printer, controller, options, layers = case
    size = (side - 4) * PITCH_UM
    components = {
        "printer": {"kind": printer, **({"variation": 0.2} if printer == "LayerDeposition" else {})},
        "profiler": {"kind": "ProfileSensor", "noise_std_um": 0.5},
        "controller": {"kind": controller, **options},
    }
    tables = {
        "grid": {"nx": side, "ny": side, "pitch_um": PITCH_UM},
        "part": {"shape": "cuboid", "size_x_um": size, "size_y_um": size, "height_um": layers * LAYER_UM},
        "run": {"layers_max": layers},
        "components": components,
    }
    return Scenario.of_text('title = "Footprint"', "footprint.toml", tables)


def _in_a_process(case: tuple[Any, ...], side: int) -> dict[str, int]:
    code = "import sys, json; from benchmarks.footprint import peak; print(peak(*json.loads(sys.argv[1])))"
    done = subprocess.run(
        [sys.executable, "-c", code, json.dumps([case, side])], check=True, capture_output=True, text=True
    )
    found: dict[str, int] = json.loads(done.stdout)
    return found


def peak(case: tuple[str, str, dict[str, int], int], side: int) -> str:
    """Print in this process; its peak memory and the bytes of the run folder as JSON."""
    scenario = _scenario(case, side)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        Result.begin(folder, scenario.text, {})
        print_part(scenario, folder=folder)
        disk = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return json.dumps({"memory": _peak_memory(), "disk": disk})


def _peak_memory() -> int:
    """Of this process alone [bytes]: ru_maxrss begins with the memory of the process that started it."""
    kibibytes = re.search(r"^VmHWM:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert kibibytes
    return int(kibibytes[1]) * KIBIBYTE

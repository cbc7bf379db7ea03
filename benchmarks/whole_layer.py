"""Cost of a layer of a whole print: plant, sensor, plan and record together, in processor time of one core."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from statistics import median

from rich.console import Group
from rich.progress import track
from rich.text import Text

from benchmarks.timing import scaled, table_of, timed
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

SIDE = 300
LAYERS = (2, 5)
"""A figure is the slope between prints of as many layers: start and end of a print do not count."""
HIGHEST = LAYERS[1] + 1
ROUNDS, ENOUGH_S = 9, 8.0
PITCH_UM, LAYER_UM = 63.5, 7.6
CONTROLLERS: Mapping[str, Mapping[str, object]] = {
    "open loop": {"kind": "OpenLoop"},
    "N = 1": {"kind": "LayerMpc", "horizon": 1},
    "N = 2": {"kind": "LayerMpc", "horizon": 2},
    "N = 3": {"kind": "LayerMpc", "horizon": 3},
    'finish = "fast"': {"kind": "LayerMpc", "finish": "fast"},
    'finish = "even", the default': {"kind": "LayerMpc"},
}
PRINTERS = (
    ("25 x 25 mm, 100 dpi", 98 * 98),
    ("100 x 100 mm, 150 dpi", 590 * 590),
    ("100 x 100 mm, 400 dpi", 1575 * 1575),
    ("380 x 380 mm, 400 dpi", 6000 * 6000),
)
"""Printed area and resolution, cells."""


def measure() -> Group:
    """Processor time per cell and layer, and what follows for printers, on one core."""
    _processor_s(CONTROLLERS["open loop"], LAYERS[0])  # the first print of a process also imports what it needs
    per_cell = {name: _per_cell(options) for name, options in track(CONTROLLERS.items(), "layer", transient=True)}
    table = table_of(
        f"a layer of a print of {SIDE} x {SIDE} cells into a folder, processor time of one core",
        ("controller", "per cell", *(f"{name}\n{cells:,} cells" for name, cells in PRINTERS)),
        texts=1,
    )
    for name, seconds in per_cell.items():
        table.add_row(name, scaled(seconds), *(scaled(seconds * cells) for _, cells in PRINTERS))
    note = f"a part {HIGHEST} layers high: with five layers ahead every plan sees the end, where it takes longest"
    return Group(table, Text(note))


def _per_cell(options: Mapping[str, object]) -> float:
    """The median of several slopes, of one where prints take long."""
    slopes: list[float] = []
    spent = 0.0
    while not slopes or (spent < ENOUGH_S and len(slopes) < ROUNDS):
        few, many = (_processor_s(options, layers) for layers in LAYERS)
        spent += few + many
        slopes.append((many - few) / (LAYERS[1] - LAYERS[0]) / SIDE**2)
    return median(slopes)


def _processor_s(options: Mapping[str, object], layers: int) -> float:
    size = (SIDE - 4) * PITCH_UM
    tables = {
        "grid": {"nx": SIDE, "ny": SIDE, "pitch_um": PITCH_UM},
        "part": {"shape": "cuboid", "size_x_um": size, "size_y_um": size, "height_um": HIGHEST * LAYER_UM},
        "run": {"layers_max": layers},
        "components": {
            "printer": {"kind": "LayerDeposition", "variation": 0.2},
            "profiler": {"kind": "ProfileSensor", "noise_std_um": 0.3},
            "controller": dict(options),
        },
    }
    scenario = Scenario.of_text('title = "Whole layers"', "whole-layer.toml", tables)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        Result.begin(folder, scenario.text, {})
        return timed(lambda: print_part(scenario, folder=folder)).processor_s

"""Peak memory of a process, and of one that prints a part."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

from inkloop.limits import KIB
from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

PITCH_UM, LAYER_UM, LAYERS = 100.0, 7.6, 2


def peak(side: int, controller: str, **options: Any) -> int:
    """Print a block of two layers over nearly all of side x side cells; the memory of this process at most [bytes]."""
    size = (side - 4) * PITCH_UM
    tables = {
        "grid": {"nx": side, "ny": side, "pitch_um": PITCH_UM},
        "part": {"shape": "cuboid", "size_x_um": size, "size_y_um": size, "height_um": LAYERS * LAYER_UM},
        "run": {"layers_max": LAYERS},
        "components": {
            "printer": {"kind": "LayerDeposition", "variation": 0.2},
            "profiler": {"kind": "ProfileSensor", "noise_std_um": 0.5},
            "controller": {"kind": controller, **options},
        },
    }
    scenario = Scenario.of_text('title = "Footprint"', "footprint.toml", tables)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        Result.begin(folder, scenario.text, {})
        print_part(scenario, folder=folder)
    return of_this_process()


def of_this_process() -> int:
    """Most memory that this process has held: VmHWM, as ru_maxrss begins with that of its parent."""
    kibibytes = re.search(r"^VmHWM:\s+(\d+) kB$", Path("/proc/self/status").read_text(), re.MULTILINE)
    assert kibibytes
    return int(kibibytes[1]) * KIB

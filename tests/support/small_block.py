"""A small block printed by a loop of real parts under our master."""

from __future__ import annotations

import numpy as np
import xarray as xr

from inkloop.component import Job
from inkloop.components import catalog
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.master.master import Master
from inkloop.master.wiring import check
from inkloop.results.recorder import Recorder

SECOND = 1_000_000_000
ANNEALING_SWEEPS = 5  # of the controller; by default up to 200 for blocks as small as this
REPRODUCIBLE = ("height", "measured_height", "valid", "estimated_height", "pattern", "objective", "droplets_a", "std")


def job() -> Job:
    mask = np.zeros((10, 9), np.bool_)
    mask[2:-2, 2:-2] = True
    return Job(10, 9, 263.256e-6, np.where(mask, 30e-6, 0.0), mask, seed=3)


def printed(
    *,
    algorithm: str = "gauss-seidel",
    step_ns: int = SECOND,
    fmi: str = "fmi3",
    duration_s: float = 0.0,
    scan_s: float = 0.0,
    horizon: int = 3,
    controller: tuple[str, dict[str, object]] = ("LayerMpc", {}),
) -> xr.Dataset:
    """The run of a small block with all the plant's and the sensor's imperfections, planned with little work."""
    tables: dict[str, tuple[str, dict[str, object]]] = {
        "controller": (
            controller[0],
            {"alpha": 0.8, "horizon": horizon, "annealing_sweeps": ANNEALING_SWEEPS, **controller[1]},
        ),
        "printer": ("LayerDeposition", {"fmi": fmi, "variation": 0.2, "layer_duration_s": duration_s}),
        "profiler": ("ProfileSensor", {"fmi": fmi, "noise_std_um": 0.3, "scan_duration_s": scan_s}),
    }
    parts = {name: catalog.make(kind, job(), options) for name, (kind, options) in tables.items()}
    wires = contract_connections(parts)
    assert check(parts, wires) == []
    recorder = Recorder(job(), parts)
    master = Master(
        parts,
        wires,
        step_ns=step_ns,
        algorithm=algorithm,  # type: ignore[arg-type]
        observers=[recorder],
        course=LayerCourse(parts, layers_max=50),
    )
    assert master.run(time_max_ns=10_000 * SECOND) == "done"
    return recorder.dataset()


def assert_same_layers(one: xr.Dataset, other: xr.Dataset) -> None:
    for name in REPRODUCIBLE:
        np.testing.assert_array_equal(one[name], other[name], err_msg=name)

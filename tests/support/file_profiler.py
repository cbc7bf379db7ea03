"""A profiler that writes files, for tests: the bed as a component lays it out, and the profiler as a second process.

`python file_profiler.py BED FOLDER METHOD`: for every surface that appears in BED, a fine map, turned and shifted, with
noise, missing pixels and patches, is written into FOLDER in the format that METHOD names, until BED/stop is there.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import sdfio
import tifffile

from inkloop.component import Job, Port, Values
from inkloop.files import replaced
from inkloop.metrology.registration import Registration
from support.fine_maps import fine_map

PITCH = 263.256e-6
PIXEL = 12e-6
TRUTH = Registration(-0.41e-3, -0.23e-3, math.radians(4.0))
SHAPE = (330, 340)
NOISE = 0.4e-6


class Bed:
    """Lays the surface of each printed layer into a folder, for the profiler to see."""

    def __init__(self, job: Job, *, folder: str) -> None:
        self.inputs = (Port("height", "m", (job.nx, job.ny)), Port("layers_printed", dtype="int32"))
        self.outputs = ()
        self._folder, self._shown = Path(folder), -1

    def initialize(self, time_ns: int, inputs: Values) -> Values:
        return {}

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        layer = int(inputs["layers_printed"])
        if layer > self._shown:
            with replaced(self._folder / f"{layer}.npy") as partial, partial.open("wb") as file:
                np.save(file, inputs["height"])
            self._shown = layer
        return {}

    def terminate(self) -> None:
        pass

    def save(self) -> bytes:
        return self._shown.to_bytes(8, "little", signed=True)

    def restore(self, saved: bytes) -> None:
        self._shown = int.from_bytes(saved, "little", signed=True)


def scanned(surface: Any, layer: int, tilt: float) -> Any:
    """(m, n) heights [m] of a surface, NaN where nothing was measured."""
    rng = np.random.default_rng(layer)
    z = fine_map(surface, PITCH, TRUTH, SHAPE, PIXEL).z + NOISE * rng.standard_normal(SHAPE)
    x, y = np.indices(SHAPE) * PIXEL
    z += tilt * (layer + 1) * (40e-6 + 3e-3 * x - 2e-3 * y)
    z[rng.random(SHAPE) < 0.05] = np.nan
    for corner in rng.integers(60, 240, (2, 2)):
        z[corner[0] : corner[0] + 30, corner[1] : corner[1] + 40] = np.nan
    return z


def write_csv(path: Path, z: Any) -> None:
    """Semicolons and decimal commas, nothing where nothing was measured; written slowly, under its own name."""
    rows = ["Height [um]\n", "Pixel size [um];12,0\n"]
    rows += [";".join("" if np.isnan(h) else f"{h * 1e6:.4f}".replace(".", ",") for h in row) + "\n" for row in z.T]
    with path.open("w") as file:
        for first in range(0, len(rows), 60):
            file.writelines(rows[first : first + 60])
            file.flush()
            time.sleep(0.005)


def write_tiff(path: Path, z: Any) -> None:
    """Floating-point millimetres, the first row at the top, and a mark when it is complete."""
    tifffile.imwrite(path, (z.T[::-1] * 1e3).astype(np.float32))
    path.with_name(f"{path.name}.done").touch()


def write_sdf(path: Path, z: Any) -> None:
    """A binary SDF, renamed when it is complete."""
    with replaced(path) as partial:
        sdfio.write(partial, z.T, x_scale=PIXEL, y_scale=PIXEL, z_scale=1e-10)


METHODS: dict[str, tuple[str, Callable[[Path, Any], None], float]] = {
    "given": ("scan_{layer}.csv", write_csv, 0.0),
    "fiducials": ("scan_{layer}.tif", write_tiff, 0.0),
    "fit": ("scan_{layer}.sdf", write_sdf, 1.0),
}
"""Registration -> name and format of the files, and how much the level and the tilt of scans drift."""


def main(bed: Path, folder: Path, method: str) -> None:
    """Scan until stopped."""
    name, write, tilt = METHODS[method]
    layer = 0
    while not (bed / "stop").exists():
        if (bed / f"{layer}.npy").exists():
            write(folder / name.format(layer=layer), scanned(np.load(bed / f"{layer}.npy"), layer, tilt))
            layer += 1
        time.sleep(0.01)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])

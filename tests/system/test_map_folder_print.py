"""A print that sees its part only through the files of another process, turned, shifted, noisy and with holes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from inkloop.printing.print import Print
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M
from support.file_profiler import METHODS, PITCH, PIXEL, SHAPE, TRUTH
from support.long_proofs import rest_is_long
from support.places import ROOT

FIDUCIALS = ((0.4e-3, 0.3e-3), (3.1e-3, 0.5e-3), (1.5e-3, 3.4e-3))
"""Places on the map, counted from its first pixel with rows going up."""


def registration_keys(method: str) -> str:
    """The options of each method: what its user would know."""
    if method == "given":
        x, y = TRUTH.offset_x * UM_PER_M, TRUTH.offset_y * UM_PER_M
        return f"offset_x_um = {x}\noffset_y_um = {y}\nrotation_deg = 4.0\n"
    if method == "fit":  # set up by eye
        return (
            f"offset_x_um = {TRUTH.offset_x * UM_PER_M + 180}\noffset_y_um = {TRUTH.offset_y * UM_PER_M - 110}\n"
            'rotation_deg = 3.2\ndatum = "plane"\ncomplete = "renamed"\nregistration = "fit"\n'
        )
    top = (SHAPE[1] - 1) * PIXEL
    on_map = [[x * UM_PER_M, (top - y) * UM_PER_M] for x, y in FIDUCIALS]
    on_grid = [[float(value) * UM_PER_M for value in TRUTH.to_grid(np.array(x), np.array(y))] for x, y in FIDUCIALS]
    return (
        f'registration = "fiducials"\nmirror = "y"\nfiducials_map_um = {on_map}\nfiducials_grid_um = {on_grid}\n'
        f'unit = "mm"\npixel_um = {PIXEL * UM_PER_M}\ncomplete = "done"\n'
    )


def scenario(folder: Path, method: str) -> Path:
    text = f"""
title = "A block, seen through files"
seed = 3
[grid]
nx = 12
ny = 12
[part]
shape = "cuboid"
size_x_um = {6 * PITCH * UM_PER_M}
size_y_um = {8 * PITCH * UM_PER_M}
height_um = 30.0
[run]
layers_max = 12
[components.controller]
kind = "LayerMpc"
alpha = 0.8
finish = "fast"
[components.printer]
kind = "LayerDeposition"
variation = 0.2
[components.bed]
kind = "support.file_profiler:Bed"
folder = {str(folder / "bed")!r}
[components.profiler]
kind = "MapFolder"
folder = "maps"
file_name = {METHODS[method][0]!r}
settle_s = 0.1
timeout_s = 120.0
{registration_keys(method)}
[components.shadow]
kind = "Shadow"
alarm_um = 10.0
"""
    path = folder / "print.toml"
    path.write_text(text)
    return path


@contextmanager
def profiler(folder: Path, method: str) -> Iterator[subprocess.Popen[bytes]]:
    bed, maps = folder / "bed", folder / "maps"
    bed.mkdir()
    maps.mkdir()
    command = [sys.executable, "-m", "support.file_profiler", str(bed), str(maps), method]
    process = subprocess.Popen(command, env={**os.environ, "PYTHONPATH": str(ROOT / "tests")})
    try:
        yield process
    finally:
        (bed / "stop").touch()
        assert process.wait(60) == 0


@pytest.mark.parametrize("method", rest_is_long(METHODS, 1))
def test_part_is_printed_as_with_a_sensor_though_only_files_are_seen(method: str, tmp_path: Path) -> None:
    with profiler(tmp_path, method):
        run = Print(Scenario.load(scenario(tmp_path, method))).run()
    dataset = run.dataset
    assert run.stop_reason == "done"
    assert 4 <= dataset.sizes["layer"] - 1 <= 10
    part = dataset.mask.values
    seen = dataset.valid.values & part
    assert seen[:, part].mean() > 0.9
    missed = (dataset.measured_height.values - dataset.height.values)[seen]
    assert np.sqrt(np.mean(missed**2)) < (0.25e-6 if method == "fit" else 0.15e-6)
    assert abs(float(dataset.mean_error[-1])) < 0.5e-6
    assert float(dataset["std"][-1]) < 1e-6

"""Prints in one block, unpacked, and the same prints by inkloop run."""

from __future__ import annotations

import tempfile
import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import fmpy
import xarray as xr

from inkloop.exchange import layer_job
from inkloop.exchange.layer_job import bake
from inkloop.fmu_writer import archive as fmu_archive
from support import prints
from support.fmus.fmu_driver import OK, Driver

MODEL = "LayerJob"
DONE = 2
CUBOID = prints.QUICK_CUBOID
_folders: list[tempfile.TemporaryDirectory[str]] = []


def printed(name: str, *overrides: tuple[str, Any]) -> xr.Dataset:
    """The print of `inkloop run`."""
    return prints.printed(name, *overrides).dataset


@lru_cache
def unpacked(form: str, name: str, *overrides: tuple[str, Any]) -> Path:
    """The folder of the block of a scenario, uncompressed and without the picture of its target: both take long."""
    folder = tempfile.TemporaryDirectory()
    _folders.append(folder)
    file = Path(folder.name) / "job.fmu"
    with patch.object(fmu_archive, "COMPRESSION", zipfile.ZIP_STORED):
        layer_job.write(bake(prints.scenario(name, overrides)), form[3], file, picture=False)  # type: ignore[arg-type]
    fmpy.extract(str(file), str(Path(folder.name) / "job"))
    return Path(folder.name) / "job"


def block(form: str, name: str, *overrides: tuple[str, Any]) -> Driver:
    """An instance of it."""
    return Driver(MODEL, form, folder=unpacked(form, name, *overrides))


def finish(fmu: Driver, step: float, at: float = 0.0) -> float:
    """Steps until the print is done; the time then."""
    number = 0
    while fmu.get("status") != DONE:
        assert fmu.step(at + number * step, step) == OK, fmu.messages
        number += 1
    return at + number * step

"""The record of a print from its run folder, or from its result in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from inkloop.contract import HEIGHT, MEASURED_HEIGHT, PATTERN, VALID, PassOrder
from inkloop.results.result import Result
from inkloop.tables.schema import Process
from inkloop_lab.errors import IdentificationError
from inkloop_lab.identify.print_record import PrintRecord


def read_run(folder: Path) -> PrintRecord:
    """The print of a run folder. Raises ResultError, IdentificationError."""
    return record_of(Result.load(folder), str(folder))


def record_of(result: Result, name: str) -> PrintRecord:
    """The print of a result: scans if there are any, else the reported surfaces. Raises IdentificationError.

    Rows of layers that were never scanned hold NaN; changes of a pattern by events are not in the record.
    """
    run = result.dataset
    surface = next((key for key in (MEASURED_HEIGHT, HEIGHT) if key in run), None)
    if surface is None or PATTERN not in run or run.sizes["layer"] < 2:
        raise IdentificationError(
            f"{name}: holds {', '.join(map(str, run.data_vars))} of {run.sizes['layer'] - 1} layers; needs pattern and "
            "measured_height of at least one layer"
        )
    measured = run[surface].values.astype(np.float64)
    if surface == MEASURED_HEIGHT and VALID in run:
        measured = np.where(run[VALID].values.astype(bool), measured, np.nan)
    process = Process.model_validate(tomlkit.parse(result.scenario_text).unwrap().get("process", {}))
    return PrintRecord(
        name,
        float(run.attrs["pitch"]),
        run[PATTERN].values[1:].astype(np.int32),
        measured,
        run["area"].values if "area" in run else None,
        process.passes,
        PassOrder[process.pass_order.upper()].value,
        process.pass_rotation,
    )

"""The record of a print from its run folder, or from its result in memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tomlkit

from inkloop.errors import IdentificationError
from inkloop.identify.print_record import PrintRecord
from inkloop.results.result import Result
from inkloop.tables.job import PASS_ORDERS
from inkloop.tables.schema import Process


def read_run(folder: Path) -> PrintRecord:
    """The print of a run folder. Raises ResultError, IdentificationError."""
    return record_of(Result.load(folder), str(folder))


def record_of(result: Result, name: str) -> PrintRecord:
    """The print of a result: scans where there are any, else surfaces as they were told. Raises IdentificationError.

    Rows of layers that were never scanned hold NaN; what an event did to the pattern on its way is not in the record.
    """
    run = result.dataset
    surface = next((key for key in ("measured_height", "height") if key in run), None)
    if surface is None or "pattern" not in run or run.sizes["layer"] < 2:
        raise IdentificationError(
            f"{name}: holds {', '.join(map(str, run.data_vars))} of {run.sizes['layer'] - 1} layers; needs pattern and "
            "measured_height of at least one layer"
        )
    measured = run[surface].values.astype(np.float64)
    if surface == "measured_height" and "valid" in run:
        measured = np.where(run["valid"].values.astype(bool), measured, np.nan)
    process = Process.model_validate(tomlkit.parse(result.scenario_text).unwrap().get("process", {}))
    return PrintRecord(
        name,
        float(run.attrs["pitch"]),
        run["pattern"].values[1:].astype(np.int32),
        measured,
        run["area"].values if "area" in run else None,
        process.passes,
        PASS_ORDERS[process.pass_order],
        process.pass_rotation,
    )

"""Error of a layer controller that prints nothing although its part lacks more than half a layer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from inkloop.contract import MEASURED_HEIGHT
from inkloop.errors import ComponentError
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M

KINDS = ("LayerMpc", "LayerController")
ALPHA = 0.8  # for both, if none is given
HORIZON_MAX = 5


def check_first_layer(scenario: Scenario, result: Result) -> None:
    """Raises ComponentError where nothing was printed although half a layer lacks, and alpha or horizon can be raised.

    A part that is lower, or that the first scan shows already, needs no layer.
    """
    if result.stop_reason != "done" or result.dataset.sizes["layer"] > 1 or MEASURED_HEIGHT not in result.dataset:
        return
    for name, table in scenario.tables.components.items():
        larger = " or ".join(_larger(table.options)) if table.kind in KINDS else ""
        if not larger:
            continue
        job, scan = scenario.job(name), result.dataset[MEASURED_HEIGHT].values[0]
        missing = float(np.nanmean((job.target_height - scan)[job.mask]))
        if missing > 0.5 * max(ink.layer_height for ink in job.inks):
            raise ComponentError(
                f"{name}: nothing was printed with {_words(table.options)}, although {missing * UM_PER_M:.3g} µm lack "
                "on average: a first layer costs more in standard deviation, of weight 1 - alpha, than it gains in "
                f"mean error, of weight alpha; choose {larger}"
            )


def _words(options: Mapping[str, Any]) -> str:
    shown = {"alpha": ALPHA, **options}
    return ", ".join(f"{name} = {shown[name]}" for name in ("alpha", "horizon", "finish") if name in shown)


def _larger(options: Mapping[str, Any]) -> Iterator[str]:
    """A larger alpha, a longer horizon, as far as there are any; a schedule of alpha may always be larger."""
    if options.get("alpha", ALPHA) != 1.0:
        yield "a larger alpha"
    if (options.get("horizon") or HORIZON_MAX) < HORIZON_MAX:
        yield "a longer horizon"

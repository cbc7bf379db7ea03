"""Check why a layer controller printed nothing although layers are missing: its alpha is too small for its horizon."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from inkloop.component import FloatMap, Job, Values
from inkloop.components import catalog
from inkloop.contract import LAYER_COMMAND, LAYERS_PRINTED, LAYERS_SCANNED, MEASURED_HEIGHT, VALID
from inkloop.errors import ComponentError
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import NS_PER_S

KINDS = ("LayerMpc", "LayerController")
ALPHA = 0.8  # for both, if none is given
HORIZON_MAX = 5
ALPHAS = tuple(k / 10 for k in range(1, 11))


def check_first_layer(scenario: Scenario, result: Result) -> None:
    """Raises ComponentError if nothing was printed but another alpha, or another horizon, would have printed.

    Where none would, the first scan shows what is to be printed already, or the part is lower than half a layer.
    """
    if result.stop_reason != "done" or result.dataset.sizes["layer"] > 1 or MEASURED_HEIGHT not in result.dataset:
        return
    for name, table in scenario.tables.components.items():
        if table.kind not in KINDS:
            continue
        job, scan = scenario.job(name), result.dataset[MEASURED_HEIGHT].values[0]
        found = [
            f"{key} = {value}"
            for key, values in _larger(table.options).items()
            for value in [_first_that_prints(table.kind, job, table.options, key, values, scan)]
            if value is not None
        ]
        if found:
            raise ComponentError(
                f"{name}: nothing was printed with {_words(table.options)}: a first layer costs more in standard "
                f"deviation, of weight 1 - alpha, than it gains in mean error, of weight alpha; {' or '.join(found)} "
                "would print"
            )


def _words(options: Mapping[str, Any]) -> str:
    shown = {"alpha": ALPHA, **options}
    return ", ".join(f"{name} = {shown[name]}" for name in ("alpha", "horizon", "finish") if name in shown)


def _larger(options: Mapping[str, Any]) -> Mapping[str, Sequence[float]]:
    """Values above those of alpha and horizon; with a schedule of alpha the values above all of it."""
    alpha, horizon = options.get("alpha", ALPHA), options.get("horizon") or HORIZON_MAX
    least = alpha if isinstance(alpha, int | float) else 0.0
    return {"alpha": [value for value in ALPHAS if value > least], "horizon": range(horizon + 1, HORIZON_MAX + 1)}


def _first_that_prints(
    kind: str, job: Job, options: Mapping[str, Any], key: str, values: Sequence[float], scan: FloatMap
) -> float | None:
    return next((value for value in values if _prints(kind, job, {**options, key: value}, scan)), None)


def _prints(kind: str, job: Job, options: Mapping[str, Any], scan: FloatMap) -> bool:
    """Whether the controller commands a layer on this surface."""
    scanned: Values = {
        MEASURED_HEIGHT: scan,
        VALID: np.ones(scan.shape, np.bool_),
        LAYERS_SCANNED: np.asarray(0, np.int32),
        LAYERS_PRINTED: np.asarray(0, np.int32),
    }
    controller = catalog.make(kind, job, options)
    try:
        controller.initialize(0, scanned)
        return int(controller.do_step(0, NS_PER_S, scanned)[LAYER_COMMAND]) > 0
    finally:
        controller.terminate()

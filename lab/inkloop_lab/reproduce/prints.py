"""Whole prints of the papers: scenarios of this package, with several seeds, by each of their controllers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario

SCENARIOS = Path(__file__).parent / "scenarios"


def printed(scenario: Scenario) -> Result:
    """One print; Ctrl-C ends it as KeyboardInterrupt."""
    result = print_part(scenario)
    if result.stop_reason == "interrupted":
        raise KeyboardInterrupt
    return result


def by_controller(
    name: str, seeds: Iterable[int], overrides: Mapping[str, Any] | None = None, *, without: Sequence[str] = ()
) -> Mapping[str, list[Result]]:
    """Label of each controller of scenario NAME.toml -> its prints, one for each seed.

    overrides: of the scenario; without: comparison runs to leave out.
    """
    found: dict[str, list[Result]] = {}
    for seed in seeds:
        scenario = Scenario.load(SCENARIOS / f"{name}.toml", {"seed": seed, **(overrides or {})})
        found.setdefault(scenario.tables.label, []).append(printed(scenario))
        for other in scenario.tables.compare:
            if other not in without:
                found.setdefault(other, []).append(printed(scenario.variant(other)))
    return found


def mean_and_scatter(values: Sequence[float]) -> tuple[float, float | None]:
    """Mean, and standard deviation over prints if there are several."""
    return float(np.mean(values)), float(np.std(values, ddof=1)) if len(values) > 1 else None

"""Prints of the rig: how they end, that they repeat, and what the benchmark says of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from benchmarks import lying_scans

from support.lying_scans.case import Case, Must
from support.lying_scans.cases import CASES
from support.lying_scans.parts import job_of
from support.lying_scans.rig import DONE, STOPPED, UNENDED, Outcome, print_case, print_cases


def test_cylinder_has_the_radius_of_ten_cells() -> None:
    assert job_of("ellipse", (25, 25)).mask.sum() == 317


def test_print_in_register_ends_flat_and_repeats() -> None:
    case = CASES["in register, 20 %"]
    one, again = (print_case(case, 1) for _ in range(2))
    assert one.ending == DONE
    assert one.mae < 0.4
    assert (one.error == again.error).all()
    assert one.layers == next(iter(print_cases([case], 1))).layers


def test_print_that_commands_nothing_more_has_stopped() -> None:
    """Also one that is only cut off has not ended."""
    case = Case("empty", Must())

    class Silent:
        inputs = outputs = ()

        def initialize(self, time_ns: int, inputs: Any) -> Any:
            return {}

        def do_step(self, time_ns: int, step_ns: int, inputs: Any) -> Any:
            layer = int(inputs["layers_scanned"])
            pattern = np.full((25, 25), int(layer < 3), np.int32)
            return {"pattern": pattern, "drop_level": pattern, "layer_command": min(layer + 1, 3), "status": 4}

        def terminate(self) -> None:
            pass

    stopped = print_case(case, 1, lambda job: Silent())
    assert (stopped.ending, stopped.layers, stopped.untrusted_from) == (STOPPED, 3, 0)
    assert print_case(case, 1, lambda job: Silent(), layers_max=2).ending == UNENDED


def outcome(**fields: Any) -> Outcome:
    figures = {"mae": 0.3, "highest": 1.0, "lowest": -1.0, "layers": 14, "ending": DONE, "untrusted_from": None}
    return Outcome(
        **{"case": "", "seed": 1, "error": np.zeros((1, 1)), "reasons": 0, "outputs": {}, **figures, **fields}
    )


@pytest.mark.parametrize(
    ("must", "found", "missed"),
    [
        (Must(0.3, 2.0), {}, []),
        (Must(0.3, 2.0), {"mae": 0.304}, []),
        (Must(0.3, 2.0), {"mae": 0.61}, ["mae 2.0 x"]),
        (Must(lowest=-12.0), {"lowest": -30.0}, ["lowest 2.4 x"]),
        (Must(), {"ending": STOPPED}, ["does not end"]),
        (Must(stop_by=14), {"ending": STOPPED}, []),
        (Must(stop_by=13), {"ending": STOPPED}, ["stops late"]),
        (Must(stop_by=14), {}, ["does not stop"]),
        (Must(0.3, or_stops=True), {"mae": 9.0, "ending": STOPPED}, []),
        (Must(trusted=True), {"untrusted_from": 3}, ["not trusted"]),
        (Must(untrusted_by=5), {"untrusted_from": 6}, ["no warning in time"]),
        (Must(untrusted_by=5), {"untrusted_from": 5}, []),
        (Must(untrusted_by=5), {}, ["no warning in time"]),
    ],
)
def test_what_is_missed_is_said(must: Must, found: dict[str, Any], missed: list[str]) -> None:
    assert lying_scans.misses(Case("", must), [outcome(**found)]) == missed

"""One print in the loop of the toys: limits and notes, what events have modified, and a failure before any layer.

tests/system/test_resume.py kills prints and resumes them.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.course.events import Event
from inkloop.course.wiring import contract_connections
from inkloop.errors import ComponentError
from inkloop.printing.print import Print
from inkloop.results.result import Result
from support.toys import toy_job, toy_loop

SECOND = 1_000_000_000
JOB = toy_job(layers=4)


class Loop:
    """The interface of a scenario for a print; `parts` are the components of the newest print."""

    def __init__(self, *, events: tuple[Event, ...] = (), **limits: Any) -> None:
        plain = {"layers_max": 100, "time_max_s": None, "step_s": 0.5, "algorithm": "gauss-seidel"}
        run = SimpleNamespace(**{**plain, "real_time_factor": None, **limits})
        self.tables = SimpleNamespace(run=run, title="Block", label="closed loop", seed=7, metrology=None)
        self.events, self.text = events, "title = 'Block'"
        self.parts = self.build(None)

    def build(self, folder: Path | None) -> dict[str, Any]:
        self.parts = toy_loop(JOB, SECOND)
        return self.parts

    @property
    def connections(self) -> Any:
        return contract_connections(self.parts)

    def job(self) -> Any:
        return JOB


def printed(loop: Any, folder: Path | None = None, **options: Any) -> Result:
    return Print(loop, folder, **options).run()


@pytest.mark.parametrize(("algorithm", "ends_s"), [("gauss-seidel", [1.5, 2.5]), ("jacobi", [2.0, 4.0])])
def test_loop_runs_with_step_algorithm_and_limits_of_the_scenario(algorithm: str, ends_s: list[float]) -> None:
    rows: list[Any] = []
    result = printed(Loop(layers_max=2, algorithm=algorithm), on_layer=rows.append, notes={"origin": "here"})
    assert result.stop_reason == "layers_max"
    np.testing.assert_allclose(result.dataset.time[1:], ends_s, rtol=1e-12)
    assert [row.layer for row in rows] == [0, 1, 2]
    assert result.run["origin"] == "here"
    assert not {"events", "real_time", "not_resumable", "resumed_after_layer"} & set(result.run)
    assert (result.run["title"], result.run["label"], result.run["seed"]) == ("Block", "closed loop", 7)
    assert printed(Loop(time_max_s=1.5)).stop_reason == "time_max"


def test_layer_is_modified_by_what_was_in_effect_in_the_step_that_completed_it() -> None:
    """Layer 2 ends with the step that begins at 2 s; the event is over in the step after it."""
    override = Event("printer.pattern", "override", at_time_ns=2 * SECOND, value=np.asarray(0, np.int32))
    events = (override, Event("printer.pattern", "reset", at_time_ns=5 * SECOND // 2))
    result = printed(Loop(layers_max=3, events=events))
    assert result.dataset.modified.values.tolist() == [False, False, True, False]
    assert result.run["events"] == [str(event) for event in events]
    assert result.dataset.attrs["events"] == f"{events[0]}\n{events[1]}"


def test_failure_before_the_first_layer_leaves_nothing(tmp_path: Path) -> None:
    class Broken(Loop):
        def build(self, folder: Path | None) -> dict[str, Any]:
            parts = super().build(folder)
            parts["controller"].initialize = lambda *_: 1 / 0
            return parts

    with pytest.raises(ComponentError, match=r"^controller could not be initialized: ZeroDivisionError: [^\n]*$"):
        printed(Broken(), tmp_path)
    assert list(tmp_path.iterdir()) == []

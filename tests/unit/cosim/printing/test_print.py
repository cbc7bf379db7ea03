"""One print and its folder: limits, notes, what is kept, and why one cannot be resumed; in the loop of the toys."""

from __future__ import annotations

import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.component import Ink, Job, Values
from inkloop.course.events import Event
from inkloop.course.layer_course import contract_connections
from inkloop.errors import ComponentError, InkloopError, ResultError
from inkloop.printing.print import Print, check_first_layer
from inkloop.results import checkpoint
from inkloop.results.checkpoint import layer_files
from inkloop.results.result import Result
from support.toys import toy_job, toy_loop

SECOND = 1_000_000_000
JOB = toy_job(layers=4)


class Kept:
    """A toy component that can be saved; it fails in the step that begins at `fails_ns`, with an `error`."""

    error: type[Exception] = RuntimeError

    def __init__(self, own: Any, saves: bool, fails_ns: int | None = None) -> None:
        self._own, self._fails_ns, self.terminated = own, fails_ns, 0
        self.inputs, self.outputs, self.initialize = own.inputs, own.outputs, own.initialize
        self.steps: list[tuple[int, int]] = []
        if saves:
            self.save = lambda: pickle.dumps({name: value for name, value in vars(own).items() if name != "_job"})
            self.restore = lambda state: vars(own).update(pickle.loads(state))

    def do_step(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        self.steps.append((time_ns, step_ns))
        if self._fails_ns is not None and time_ns >= self._fails_ns:
            raise self.error("needs a person, then `inkloop bench clear SCENARIO`")
        found: Values = self._own.do_step(time_ns, step_ns, inputs)
        return found

    def terminate(self) -> None:
        self.terminated += 1


class Loop:
    """The interface of a scenario for a print; `parts` are the components of the newest print."""

    def __init__(
        self, *, saves: bool = True, fails_ns: int | None = None, events: tuple[Event, ...] = (), **limits: Any
    ) -> None:
        plain = {"layers_max": 100, "time_max_s": None, "step_s": 0.5, "algorithm": "gauss-seidel"}
        run = SimpleNamespace(**{**plain, "real_time_factor": None, **limits})
        self.tables = SimpleNamespace(run=run, title="Block", label="closed loop", seed=7, metrology=None)
        self.events, self.text, self._saves, self._fails_ns = events, "title = 'Block'", saves, fails_ns
        self.buses = ()
        self.parts = self.build(None)

    def build(self, folder: Path | None) -> dict[str, Any]:
        loop = toy_loop(JOB, SECOND)
        self.parts = {
            name: Kept(part, self._saves or name != "printer", self._fails_ns if name == "profiler" else None)
            for name, part in loop.items()
        }
        return self.parts

    @property
    def connections(self) -> Any:
        return contract_connections(self.parts)

    def job(self) -> Any:
        return JOB


def printed(loop: Any, folder: Path | None = None, **options: Any) -> Result:
    return Print(loop, folder, **options).run()


def heights(result: Result) -> list[float]:
    return [float(value) for value in result.dataset.height.values[:, 1, 1] * 1e5]


@pytest.mark.parametrize(("algorithm", "ends_s"), [("gauss-seidel", [1.5, 2.5]), ("jacobi", [2.0, 4.0])])
def test_loop_runs_with_step_algorithm_and_limits_of_the_scenario(algorithm: str, ends_s: list[float]) -> None:
    loop = Loop(layers_max=2, algorithm=algorithm)
    rows: list[Any] = []
    result = printed(loop, on_layer=rows.append, notes={"origin": "here"})
    assert result.stop_reason == "layers_max"
    np.testing.assert_allclose(result.dataset.time[1:], ends_s, rtol=1e-12)
    assert [row.layer for row in rows] == [0, 1, 2]
    assert loop.parts["printer"].steps[:2] == [(0, SECOND // 2), (SECOND // 2, SECOND // 2)]
    assert result.run["origin"] == "here"
    assert not {"events", "real_time", "not_resumable", "resumed_after_layer"} & set(result.run)
    assert (result.run["title"], result.run["label"], result.run["seed"]) == ("Block", "closed loop", 7)
    assert printed(Loop(time_max_s=1.5)).stop_reason == "time_max"


def test_print_in_real_time_has_an_account_of_its_deadlines() -> None:
    found = printed(Loop(layers_max=2, real_time_factor=1e5)).run["real_time"]
    assert (found["real_time_factor"], found["steps"]) == (1e5, 5)


def test_layer_is_modified_by_what_was_in_effect_in_the_step_that_completed_it() -> None:
    """Layer 2 ends with the step that begins at 2 s; the event is over in the step after it."""
    override = Event("printer.pattern", "override", at_time_ns=2 * SECOND, value=np.asarray(0, np.int32))
    events = (override, Event("printer.pattern", "reset", at_time_ns=5 * SECOND // 2))
    result = printed(Loop(layers_max=3, events=events))
    assert result.dataset.modified.values.tolist() == [False, False, True, False]
    assert result.run["events"] == [str(event) for event in events]
    assert result.dataset.attrs["events"] == f"{events[0]}\n{events[1]}"


class NewPart(InkloopError):
    has_own_remedy = True


def test_error_that_says_what_to_do_is_followed_by_no_other_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that asks for a new part must not end with an advice to resume this one."""
    monkeypatch.setattr(Kept, "error", NewPart)
    with pytest.raises(ComponentError) as raised:
        printed(Loop(fails_ns=5 * SECOND // 2), tmp_path)
    assert str(raised.value).split("\n")[1] == f"layers 0 to 2 are in {tmp_path}"


def test_print_that_has_ended_leaves_no_checkpoints_and_an_interrupted_one_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checkpoint, "STATE_SHARE", 1.0)
    whole = printed(Loop())
    failing = Loop(fails_ns=5 * SECOND // 2)
    with pytest.raises(ComponentError) as raised:
        printed(failing, tmp_path)
    message, advice = str(raised.value).split("\n")
    assert message.startswith("profiler failed at t = 2.5 s, after layer 2")
    assert "needs a person, then `inkloop bench clear SCENARIO`" in message
    assert advice == (f"layers 0 to 2 are in {tmp_path}; fix the cause, then continue with `inkloop resume {tmp_path}`")
    assert Result.load(tmp_path).stop_reason == "failed"
    assert layer_files(tmp_path)
    result = printed(Loop(), tmp_path)
    assert result.run["resumed_after_layer"] == 2
    assert result.stop_reason == "done"
    assert heights(result) == pytest.approx(heights(whole), rel=1e-9, abs=0.0)
    np.testing.assert_array_equal(result.dataset.time, whole.dataset.time)
    assert not layer_files(tmp_path)


def test_print_that_cannot_be_resumed_keeps_its_layers_and_says_why(tmp_path: Path) -> None:
    with pytest.raises(ComponentError) as raised:
        printed(Loop(saves=False, fails_ns=3 * SECOND // 2), tmp_path)
    assert str(raised.value).endswith(
        f"layers 0 to 1 are in {tmp_path}; the run cannot be resumed: printer has no save and no restore"
    )
    assert Result.load(tmp_path).run["not_resumable"] == "printer has no save and no restore"
    again = Loop(saves=False)
    with pytest.raises(ResultError) as refused:
        printed(again, tmp_path)
    assert str(refused.value) == (
        f"{tmp_path}: cannot be resumed: printer has no save and no restore; its layers 0 to 1 are in result.nc; "
        "run the scenario again for the others"
    )
    assert [part.terminated for part in again.parts.values()] == [1, 1, 1]
    assert not any(part.steps for part in again.parts.values())
    found = Result.load(tmp_path)
    assert (found.stop_reason, found.dataset.sizes["layer"]) == ("interrupted", 2)


def test_failure_before_the_first_layer_leaves_nothing(tmp_path: Path) -> None:
    class Broken(Loop):
        def build(self, folder: Path | None) -> dict[str, Any]:
            parts = super().build(folder)
            parts["controller"].initialize = lambda *_: 1 / 0
            return parts

    with pytest.raises(ComponentError, match=r"^controller could not be initialized: ZeroDivisionError: [^\n]*$"):
        printed(Broken(), tmp_path)
    assert list(tmp_path.iterdir()) == []


INKS = (Ink(), Ink(3e-6, 0.5e-6, 0.1e-6))
"""Layers of 7.6 and of 5.4 um."""


def first_layer(
    options: dict[str, Any], lacks_um: float = 5.0, *, reason: str = "done", layers: int = 1, kind: str = "LayerMpc"
) -> None:
    """A print of a part of 20 um on what is lower by `lacks_um` in its cells, of which one was not measured."""
    mask = np.zeros((4, 3), np.bool_)
    mask[1:3] = True
    target = np.where(mask, 20e-6, 0.0)
    scan = np.where(mask, target - lacks_um * 1e-6, 300e-6)
    scan[1, 0] = np.nan
    part = Job(4, 3, 1e-4, target, mask, inks=INKS)
    components = {
        "printer": SimpleNamespace(kind="LayerDeposition"),
        "own": SimpleNamespace(kind=kind, options=options),
    }
    loop: Any = SimpleNamespace(tables=SimpleNamespace(components=components), job=lambda name: part)
    maps = {"measured_height": (("layer", "x", "y"), np.repeat(scan[None], layers, axis=0))}
    found: Any = SimpleNamespace(stop_reason=reason, dataset=xr.Dataset(maps))
    check_first_layer(loop, found)


@pytest.mark.parametrize(
    ("options", "with_", "choice"),
    [
        ({}, "alpha = 0.8", "a larger alpha"),
        ({"alpha": 0.5, "horizon": 4}, "alpha = 0.5, horizon = 4", "a larger alpha or a longer horizon"),
        ({"alpha": 1.0, "horizon": 1, "finish": True}, "alpha = 1.0, horizon = 1, finish = True", "a longer horizon"),
        ({"alpha": 0.7, "horizon": 5}, "alpha = 0.7, horizon = 5", "a larger alpha"),
        ({"alpha": [1.0, 0.5]}, "alpha = [1.0, 0.5]", "a larger alpha"),
    ],
)
def test_print_whose_first_layer_does_not_pay_is_an_error_with_what_can_be_raised(
    options: dict[str, Any], with_: str, choice: str
) -> None:
    with pytest.raises(ComponentError) as raised:
        first_layer(options)
    message = str(raised.value)
    assert message.startswith(f"own: nothing was printed with {with_}, although 5 µm lack on average: ")
    assert message.endswith(f"; choose {choice}")


def test_print_that_lacks_less_than_half_a_layer_or_was_not_ended_by_its_controller_is_none() -> None:
    """Half of the higher of the two layers."""
    first_layer({}, 3.7)
    with pytest.raises(ComponentError, match=r"although 3\.9 µm lack"):
        first_layer({}, 3.9)
    first_layer({}, reason="time_max")
    first_layer({}, layers=2)
    first_layer({}, kind="OpenLoop")
    first_layer({"alpha": 1.0, "horizon": 5})
    first_layer({"alpha": 1.0})


def test_event_that_is_in_effect_at_the_start_alone_marks_the_start_alone() -> None:
    """The start surface belongs to the step that would begin at 0."""
    events = (
        Event("printer.pattern", "bias", at_time_ns=0, value=np.asarray(0, np.int32)),
        Event("printer.pattern", "reset", at_time_ns=SECOND // 2),
    )
    result = printed(Loop(layers_max=2, events=events))
    assert result.dataset.modified.values.tolist() == [True, False, False]


@pytest.mark.parametrize(("error", "told"), [(NewPart, False), (RuntimeError, True)])
def test_failed_print_on_devices_names_what_the_bench_takes(
    error: type[Exception], told: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Kept, "is_device", True, raising=False)
    monkeypatch.setattr(Kept, "error", error)
    with pytest.raises(ComponentError) as raised:
        printed(Loop(fails_ns=5 * SECOND // 2), tmp_path)
    kept, bench = f"layers 0 to 2 are in {tmp_path}", f" (`inkloop bench` takes {tmp_path} as SCENARIO)"
    remedy = f"; fix the cause{bench}, then continue with `inkloop resume {tmp_path}`"
    assert str(raised.value).split("\n")[1] == kept + (remedy if told else bench)

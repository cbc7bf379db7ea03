from __future__ import annotations

import signal
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from inkloop.component import Port, Status, Values
from inkloop.course.events import Event
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import ComponentError, ScenarioError
from inkloop.master.interrupt import deferred
from inkloop.master.master import Algorithm, Master, Turns
from inkloop.master.wiring import Connection, checked_output
from inkloop.results.checkpoint import Checkpoint
from inkloop.results.recorder import Recorder
from support.toys import FunctionComponent, Resumable, toy_job, toy_loop

SECOND = 1_000_000_000


class Trace:
    """Observer that keeps one output of one component."""

    def __init__(self, place: str) -> None:
        self._component, self._port = place.split(".")
        self.times: list[int] = []
        self.values: list[float] = []

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.stepped(time_ns, outputs)

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.times.append(time_ns)
        self.values.append(float(outputs[self._component][self._port]))


def counter() -> FunctionComponent:
    """Puts out the number of its steps."""
    count = iter(range(1, 1000))
    return FunctionComponent(
        outputs=[Port("y")], step=lambda time_ns, step_ns, values: {"y": np.asarray(float(next(count)))}
    )


def follower(start: float = 0.0) -> FunctionComponent:
    """Puts out its input."""
    return FunctionComponent(
        inputs=[Port("x")],
        outputs=[Port("y", start=start)],
        start=lambda values: {"y": values["x"]},
        step=lambda time_ns, step_ns, values: {"y": values["x"]},
    )


def test_gauss_seidel_passes_the_newest_outputs_and_jacobi_those_of_the_last_point() -> None:
    algorithm: Algorithm
    for algorithm, expected in (("gauss-seidel", [0.0, 1.0, 2.0, 3.0]), ("jacobi", [0.0, 0.0, 1.0, 2.0])):
        trace = Trace("b.y")
        parts = {"a": counter(), "b": follower()}
        Master(parts, [Connection("a.y", "b.x")], step_ns=1, algorithm=algorithm, observers=[trace]).run(time_max_ns=3)
        assert trace.values == expected


def test_slow_component_steps_every_so_often_and_holds_in_between() -> None:
    slow = counter()
    trace = Trace("slow.y")
    Master({"slow": slow}, [], step_ns=10, every={"slow": 3}, observers=[trace]).run(time_max_ns=60)
    assert trace.values == [0, 0, 0, 1, 1, 1, 2]
    assert slow.log[1:-1] == ["do_step 0 30", "do_step 30 30"]


def test_slow_component_of_a_resumed_run_steps_when_it_would_have() -> None:
    slow = Resumable(outputs=[Port("y")])
    point = Checkpoint(40, 0, {"slow": {"y": np.asarray(0.0)}}, {"slow": b""})
    Master({"slow": slow}, [], step_ns=10, every={"slow": 3}).run(time_max_ns=90, resume=point)
    assert slow.log[1:-1] == ["do_step 30 30", "do_step 60 30"]


def test_resumed_run_begins_with_time_and_outputs_of_its_checkpoint() -> None:
    source = Resumable(outputs=[Port("y", start=3.0)], step=lambda *_: {"y": np.asarray(9.0)})
    sink = Resumable(
        inputs=[Port("x")], outputs=[Port("y")], step=lambda time_ns, step_ns, values: {"y": 2.0 * values["x"]}
    )
    outputs: dict[str, Values] = {"sink": {"y": np.asarray(6.0)}, "source": {"y": np.asarray(7.0)}}
    trace = Trace("sink.y")
    master = Master({"sink": sink, "source": source}, [Connection("source.y", "sink.x")], step_ns=10, observers=[trace])
    point = Checkpoint(40, 2, outputs, {"sink": b"", "source": b""})
    assert master.run(time_max_ns=60, resume=point) == "time_max"
    assert trace.times == [40, 50, 60]
    assert trace.values == [6.0, 14.0, 18.0]


def test_steps_below_one_are_refused_at_once() -> None:
    parts = {"a": counter(), "b": counter(), "c": counter()}
    with pytest.raises(ScenarioError) as raised:
        Master(parts, [], step_ns=0, every={"a": 0, "b": 1, "c": -2})
    assert list(raised.value.errors) == [
        "a: every 0 steps; needs a whole number >= 1",
        "c: every -2 steps; needs a whole number >= 1",
        "step is 0 ns; needs at least 1 ns",
    ]
    Master(parts, [], step_ns=1)


def test_events_of_a_slow_component_begin_with_the_step_that_begins_then() -> None:
    """Its inputs and outputs alike, and what is asked of its inputs between steps."""
    got: list[float] = []

    def keep(time_ns: int, step_ns: int, values: Values) -> Values:
        got.append(float(values["x"]))
        return {"y": np.asarray(0.0)}

    slow = FunctionComponent(inputs=[Port("x")], outputs=[Port("y")], step=keep)
    events = [Event(f"slow.{port}", "bias", at_time_ns=31, value=np.asarray(1.0)) for port in "xy"]
    trace = Trace("slow.y")
    master = Master(
        {"slow": slow},
        [],
        step_ns=10,
        every={"slow": 3},
        observers=[trace],
        course=LayerCourse({"slow": slow}, events=events),
    )
    master.run(time_max_ns=120)
    assert got == [0.0, 0.0, 1.0, 1.0]
    assert trace.values == [0.0] * 9 + [1.0] * 4
    assert [float(master.inputs("slow", time_ns)["x"]) for time_ns in (30, 31)] == [0.0, 1.0]


@pytest.mark.parametrize(("algorithm", "expected"), [("gauss-seidel", [0.0, 5.0, 5.0]), ("jacobi", [0.0, 0.0, 5.0])])
def test_event_of_an_input_begins_with_the_command_that_reaches_it(algorithm: Algorithm, expected: list[float]) -> None:
    numbers = iter([2, 3, 3])
    commander = FunctionComponent(
        outputs=[Port("layer_command", dtype="int32")], step=lambda *_: {"layer_command": np.asarray(next(numbers))}
    )
    got: list[float] = []

    def keep(time_ns: int, step_ns: int, values: Values) -> Values:
        got.append(float(values["x"]))
        return {}

    parts = {"commander": commander, "sink": FunctionComponent(inputs=[Port("x")], step=keep)}
    event = Event("sink.x", "override", at_layer=3, value=np.asarray(5.0))
    Master(parts, [], step_ns=1, algorithm=algorithm, course=LayerCourse(parts, events=[event])).run(time_max_ns=3)
    assert got == expected


def test_loop_that_starts_from_a_map_with_a_hole_is_refused() -> None:
    hole = np.array([[1.0, 2.0, np.nan], [4.0, 5.0, 6.0]])
    ports: dict[str, Any] = {"inputs": [Port("x", shape=(2, 3))], "outputs": [Port("y", shape=(2, 3), start=hole)]}
    parts = {"a": FunctionComponent(**ports), "b": FunctionComponent(**ports)}
    with pytest.raises(ComponentError, match=r"^a\.x stands in a loop with b\.y, which has no start value"):
        Master(parts, [Connection("b.y", "a.x"), Connection("a.y", "b.x")], step_ns=1).run(time_max_ns=1)


def test_run_ends_at_the_limit_that_comes_first() -> None:
    def end(scan_ns: int = 0, *, layers_max: int, **limits: Any) -> tuple[str, int]:
        """The reason, and the last layer printed, which is scanned too."""
        parts = toy_loop(toy_job(), profiler_ns=scan_ns)
        recorder = Recorder(toy_job(), parts)
        course = LayerCourse(parts, layers_max=layers_max)
        wires = contract_connections(parts)
        reason = Master(parts, wires, step_ns=SECOND, observers=[recorder], course=course).run(**limits)
        assert reason == "time_max" or recorder.scanned == recorder.layers
        return reason, recorder.layers

    assert end(layers_max=3) == end(4 * SECOND, layers_max=3) == ("layers_max", 3)
    assert end(layers_max=3, time_max_ns=2 * SECOND) == ("time_max", 1)
    assert end(layers_max=30) == ("done", 5)


def test_run_without_an_end_is_refused() -> None:
    with pytest.raises(ScenarioError, match="time_max_s"):
        Master({"a": counter()}, [], step_ns=1, course=LayerCourse({"a": counter()}, layers_max=3)).run()
    parts = toy_loop(toy_job())
    with pytest.raises(ScenarioError, match="nothing ends this run"):
        Master(parts, contract_connections(parts), step_ns=1, course=LayerCourse(parts)).run()
    with pytest.raises(ScenarioError, match="nothing ends this run"):
        Master(parts, contract_connections(parts), step_ns=1).run()


def test_array_that_its_source_changes_and_gives_again_is_checked_again() -> None:
    own = np.zeros((2, 3))
    given = own.view()
    given.flags.writeable = False

    def step(time_ns: int, step_ns: int, inputs: Values) -> Values:
        own[0, 1] = np.inf if time_ns >= 2 * SECOND else 1.0
        return {"height": given}

    source = FunctionComponent(outputs=[Port("height", "m", (2, 3))], step=step)
    sink = FunctionComponent(inputs=[Port("height", "m", (2, 3))])
    master = Master({"source": source, "sink": sink}, [Connection("source.height", "sink.height")], step_ns=SECOND)
    with pytest.raises(ComponentError, match=r"source failed at t = 2 s: output height is inf in cell \(0, 1\)"):
        master.run(time_max_ns=5 * SECOND)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ({}, "declared but not returned"),
        ({"y": np.zeros(2)}, r"has shape \(2,\), declared \(\)"),
        ({"y": np.asarray("five")}, "is <U4, declared float64"),
        (None, "a failed at t = 0 s: a NoneType was returned; needs the outputs by name"),
        ([1.0], "a failed at t = 0 s: a list was returned; needs the outputs by name"),
    ],
)
def test_output_must_be_what_was_declared(value: Any, message: str) -> None:
    part = FunctionComponent(outputs=[Port("y")], step=lambda *_: value)
    with pytest.raises(ComponentError, match=message):
        Master({"a": part}, [], step_ns=1).run(time_max_ns=1)


def test_output_takes_the_declared_type_and_may_be_no_number_where_nothing_reads_it() -> None:
    given = iter([np.asarray(np.float32(0.5)), np.asarray(np.nan)])
    types = []

    class Types(Trace):
        def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
            super().stepped(time_ns, outputs)
            types.append(outputs["a"]["y"].dtype)

    trace = Types("a.y")
    part = FunctionComponent(outputs=[Port("y")], step=lambda *_: {"y": next(given)})
    Master({"a": part}, [], step_ns=1, observers=[trace]).run(time_max_ns=2)
    np.testing.assert_array_equal(trace.values, [0.0, 0.5, np.nan])
    assert set(types) == {np.dtype(np.float64)}


def test_first_cell_that_is_no_number_is_named() -> None:
    spoilt = np.zeros((2, 3))
    spoilt[0, 2] = spoilt[1, 0] = np.inf
    with pytest.raises(ComponentError, match=r"^output y is inf in cell \(0, 2\)$"):
        checked_output(Port("y", shape=(2, 3)), {"y": spoilt}, True)
    with pytest.raises(ComponentError, match=r"^output y is nan$"):
        checked_output(Port("y"), {"y": np.asarray(np.nan)}, True)


def test_consumer_cannot_change_what_its_source_gave() -> None:
    def spoil(time_ns: int, step_ns: int, inputs: Values) -> Values:
        inputs["x"][...] = 5.0
        return {}

    parts = {"a": counter(), "b": FunctionComponent(inputs=[Port("x")], step=spoil)}
    with pytest.raises(ComponentError, match="b failed at t = 0 s: ValueError: assignment destination is read-only"):
        Master(parts, [Connection("a.y", "b.x")], step_ns=1).run(time_max_ns=1)


class StoppingController(Resumable):
    """Stops from the second of its steps on, until it is told that a person has looked."""

    def __init__(self, inputs: Sequence[Port] = (Port("looked_at", dtype="bool"),), with_reason: bool = True) -> None:
        reason = [Port("stop_reason", dtype="int32")] if with_reason else []
        super().__init__(inputs, [Port("layer_command", dtype="int32"), *reason], self._step_once)
        self.told: list[bool] = []

    def _step_once(self, time_ns: int, step_ns: int, inputs: Values) -> Values:
        self.told.append(bool(inputs.get("looked_at", False)))
        reason = 64 if time_ns == 10 and not self.told[-1] else 0
        return {"layer_command": np.asarray(1, np.int32), "stop_reason": np.asarray(reason, np.int32)}


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_run_ends_where_its_controller_has_stopped(algorithm: Algorithm) -> None:
    controller, kept = StoppingController(), list[tuple[str, int]]()
    parts = {"other": counter(), "controller": controller}
    master = Master(
        parts,
        [],
        step_ns=10,
        algorithm=algorithm,
        course=LayerCourse(parts),
        on_end=lambda reason, time_ns, outputs: kept.append((reason, time_ns)),
    )
    assert master.run(time_max_ns=100) == "stopped"
    assert (controller.told, kept, controller.log[-1]) == ([False, False], [("stopped", 20)], "terminate")


@pytest.mark.parametrize("every", [1, 3])
@pytest.mark.parametrize("reason", [64, 0])
def test_controller_of_a_run_that_was_stopped_is_told_once_that_a_person_has_looked(reason: int, every: int) -> None:
    controller = StoppingController()
    outputs = {"layer_command": np.asarray(1, np.int32), "stop_reason": np.asarray(reason, np.int32)}
    point = Checkpoint(0, 1, {"controller": outputs}, {"controller": b""})
    parts = {"controller": controller}
    course = LayerCourse(parts)
    master = Master(parts, [], step_ns=10 // every, every={"controller": every}, course=course)
    assert master.run(time_max_ns=10 * every, resume=point) == "time_max"
    assert controller.told[0] == (reason > 0)
    assert not any(controller.told[1:])


def loop_of(parts: dict[str, Any], layers_max: int = 100, **options: Any) -> Master:
    """The toys as the layer contract connects them."""
    course = LayerCourse(parts, layers_max=layers_max)
    return Master(parts, contract_connections(parts), **{"step_ns": SECOND, **options}, course=course)


def test_consumer_gets_the_outputs_of_initialize_and_in_a_circle_start_values() -> None:
    """The source is initialized before those that it feeds, whatever the order of the scenario."""
    source = FunctionComponent(outputs=[Port("y", start=3.0)], start=lambda values: {"y": np.asarray(7.0)})
    trace = Trace("b.y")
    Master({"b": follower(), "a": source}, [Connection("a.y", "b.x")], step_ns=1, observers=[trace]).run(time_max_ns=1)
    assert trace.values[0] == 7.0
    parts, trace = {"a": follower(start=1.0), "b": follower(start=5.0)}, Trace("a.y")
    Master(parts, [Connection("b.y", "a.x"), Connection("a.y", "b.x")], step_ns=1, observers=[trace]).run(time_max_ns=0)
    assert trace.values == [5.0]


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("step_ns", [SECOND // 3, SECOND, 5 * SECOND, 40 * SECOND])
@pytest.mark.parametrize("durations", [(0, 0), (2 * SECOND, 6 * SECOND)])
def test_same_layers_whatever_the_master_and_its_step(
    algorithm: Algorithm, step_ns: int, durations: tuple[int, int]
) -> None:
    job = toy_job(layers=5)
    parts = toy_loop(job, *durations)
    recorder = Recorder(job, parts)
    master = loop_of(parts, step_ns=step_ns, algorithm=algorithm, observers=[recorder])
    assert master.run() == "done"
    printed = recorder.dataset()
    assert printed.sizes["layer"] == 6
    np.testing.assert_array_equal(printed.height[-1], job.target_height)
    np.testing.assert_array_equal(printed.measured_height, printed.height)
    np.testing.assert_array_equal(printed.estimated_height, printed.height)
    np.testing.assert_array_equal(printed.pattern[1:], np.broadcast_to(job.mask, (5, *job.mask.shape)))
    wall = master.wall_s
    assert set(wall) == {*parts, "observers", "master", "total"}
    assert min(wall.values()) >= 0
    assert 2 * wall["total"] == pytest.approx(sum(wall.values()), rel=1e-9, abs=0.0)


@pytest.mark.parametrize(("status", "reason", "calls"), [(Status.DONE, "time_max", 5), (Status.FAULT, "fault", 3)])
def test_fault_of_any_component_ends_a_print_and_done_that_of_the_controller_alone(
    status: Status, reason: str, calls: int
) -> None:
    part = FunctionComponent([], [Port("status", dtype="int32")], lambda *_: {"status": np.asarray(int(status))})
    course = LayerCourse({"printer": part})
    assert Master({"printer": part}, [], step_ns=1, course=course).run(time_max_ns=3) == reason
    assert len(part.log) == calls


def test_component_that_exits_ends_the_run_with_its_name() -> None:
    def leave(*_: object) -> Values:
        raise SystemExit(3)

    with pytest.raises(ComponentError, match=r"^a could not be initialized: SystemExit: 3"):
        Master({"a": FunctionComponent(start=leave)}, [], step_ns=1).run(time_max_ns=1)
    with pytest.raises(ComponentError, match=r"^a failed at t = 0 s: SystemExit: 3"):
        Master({"a": FunctionComponent(step=leave)}, [], step_ns=1).run(time_max_ns=1)


class Sticky(FunctionComponent):
    """Cannot be terminated."""

    def terminate(self) -> None:
        raise OSError("device is gone")


def test_components_are_terminated_once_whatever_fails() -> None:
    """A failure of that does not hide why the run ended."""

    def refuse(values: Values) -> Values:
        raise ValueError("nozzle cover is on")

    good, sticky, late = counter(), Sticky(start=refuse), counter()
    with pytest.raises(ComponentError, match="sticky could not be initialized: ValueError: nozzle cover is on") as told:
        Master({"good": good, "sticky": sticky, "late": late}, [], step_ns=1).run(time_max_ns=1)
    assert [part.log.count("terminate") for part in (good, late)] == [1, 1]
    (note,) = told.value.__notes__
    assert note.startswith("sticky could not be terminated: OSError: device is gone")
    good = counter()
    with pytest.raises(ComponentError, match=r"sticky could not be terminated: .*device is gone"):
        Master({"good": good, "sticky": Sticky()}, [], step_ns=1).run(time_max_ns=1)
    assert good.log[-1] == "terminate"


def failing(time_ns: int, own: Any, fail: Any) -> Any:
    """A step that fails from a time on."""

    def step(begin_ns: int, step_ns: int, inputs: Values) -> Values:
        if begin_ns >= time_ns:
            fail()
        found: Values = own(begin_ns, step_ns, inputs)
        return found

    return step


def test_failure_names_component_time_and_layer() -> None:
    def fail() -> None:
        raise RuntimeError("laser is off")

    parts = toy_loop(toy_job())
    parts["profiler"].do_step = failing(2 * SECOND, parts["profiler"].do_step, fail)
    with pytest.raises(ComponentError, match=r"profiler failed at t = 2 s, after layer 2: RuntimeError: laser is off"):
        loop_of(parts).run()


def test_interrupt_ends_after_the_step_and_keeps_what_was_recorded() -> None:
    parts = toy_loop(toy_job())
    interrupt = iter([lambda: signal.raise_signal(signal.SIGINT)])
    parts["printer"].do_step = failing(3 * SECOND, parts["printer"].do_step, lambda: next(interrupt)())
    recorder = Recorder(toy_job(), parts)
    handler = signal.getsignal(signal.SIGINT)
    assert loop_of(parts, 5, observers=[recorder]).run() == "interrupted"
    assert recorder.layers == 3
    assert np.isfinite(recorder.dataset().measured_height).all()
    assert signal.getsignal(signal.SIGINT) is handler


def test_first_interrupt_is_told_to_every_block_and_the_second_is_not_deferred() -> None:
    """Also after the inner block has ended, within the outer one."""
    handler = signal.getsignal(signal.SIGINT)
    with deferred() as outer:
        with deferred() as quiet:
            assert not quiet()
        with deferred() as inner:
            signal.raise_signal(signal.SIGINT)
            assert (inner(), outer(), quiet()) == (True, True, False)
            assert signal.getsignal(signal.SIGINT) is handler
        assert signal.getsignal(signal.SIGINT) is handler
    assert signal.getsignal(signal.SIGINT) is handler


def test_end_of_the_print_goes_before_the_limit_of_time_and_both_before_an_interrupt() -> None:
    def end(**limits: Any) -> list[str]:
        """Reasons of a course that ends at 2, of a run that is interrupted at once."""
        part = FunctionComponent(outputs=[Port("layers_printed", dtype="int32")], step=lambda *_: {
            "layers_printed": np.asarray(1, np.int32)})  # fmt: skip
        course = LayerCourse({"a": part}, layers_max=limits.pop("layers_max", 9))
        turns = Master({"a": part}, [], step_ns=2, course=course).turns(**limits, interrupted=lambda: True)
        return list(ended(turns))

    assert end(time_max_ns=0) == ["time_max"]
    assert end(time_max_ns=0, layers_max=0) == ["layers_max"]
    assert end() == ["interrupted"]


def ended(turns: Turns) -> Iterator[str]:
    """The reason of a run that takes no step."""
    yield (yield from turns)  # type: ignore[misc]


class Counting:
    """A clock in nanoseconds that advances by one whenever it is looked at."""

    def __init__(self) -> None:
        self.now = 0

    def __call__(self) -> int:
        self.now += 1
        return self.now


def test_time_of_each_part_is_the_sum_of_its_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each call takes 1 ns of this clock: `initialize` and three steps of `a`, one of `b`; the observers see four."""
    monkeypatch.setattr("inkloop.master.master.perf_counter_ns", Counting())
    master = Master({"a": counter(), "b": counter()}, [], step_ns=1, every={"b": 3}, observers=[Trace("a.y")])
    master.run(time_max_ns=3)
    wall = {name: round(seconds * 1e9) for name, seconds in master.wall_s.items()}
    calls = 4 + 2 + 4
    assert wall == {"a": 4, "b": 2, "observers": 4, "total": 2 * calls + 1, "master": 2 * calls + 1 - calls}


def printing(**outputs: tuple[int, ...]) -> FunctionComponent:
    """Puts out these numbers step by step, and starts with the first of each."""
    given = {name: iter(numbers[1:]) for name, numbers in outputs.items()}
    ports = [Port(name, dtype="int32", start=numbers[0]) for name, numbers in outputs.items()]
    return FunctionComponent(
        outputs=ports, step=lambda *_: {name: np.asarray(next(rest), np.int32) for name, rest in given.items()}
    )


def test_print_ends_when_its_last_layer_is_scanned_and_counts_for_layers_printed_alone() -> None:
    scans = printing(layers_scanned=(-1, 0, 1, 2, 3))
    course = LayerCourse({"profiler": scans}, layers_max=2)
    assert course.endless == "no component counts layers"
    assert course.place({"profiler": {"layers_scanned": np.asarray(5)}}) == ""
    with pytest.raises(ScenarioError, match="nothing ends this run: no component counts layers; set time_max_s"):
        Master({"profiler": scans}, [], step_ns=1, course=course).run()
    parts = {"printer": printing(layers_printed=(0, 1, 2, 2, 2, 2)), "profiler": scans}
    course = LayerCourse(parts, layers_max=2)
    assert (course.endless, LayerCourse(parts).endless) == ("", "no component counts layers")
    ends: list[int] = []
    master = Master(parts, [], step_ns=1, course=course, on_end=lambda reason, time_ns, outputs: ends.append(time_ns))
    assert (master.run(), ends) == ("layers_max", [3])
    assert course.place(
        {"printer": {"layers_printed": np.asarray(7)}, "profiler": {"layers_scanned": np.asarray(5)}}
    ) == ("after layer 7")


def test_controller_that_is_told_by_another_component_is_not_told_by_the_course() -> None:
    """Its input is connected: what the source says counts."""
    controller = StoppingController()
    source = Resumable(outputs=[Port("y", dtype="bool")])
    parts = {"source": source, "controller": controller}
    wire = Connection("source.y", "controller.looked_at")
    outputs: dict[str, Values] = {
        "source": {"y": np.asarray(False)},
        "controller": {"layer_command": np.asarray(1, np.int32), "stop_reason": np.asarray(64, np.int32)},
    }
    point = Checkpoint(0, 1, outputs, {"source": b"", "controller": b""})
    course = LayerCourse(parts, fed={wire.target})
    assert Master(parts, [wire], step_ns=10, course=course).run(time_max_ns=10, resume=point) == "stopped"
    assert controller.told == []


@pytest.mark.parametrize(("status", "reason"), [(Status.UNTRUSTED, "time_max"), (Status.FAULT, "fault")])
def test_untrusted_part_ends_no_print(status: Status, reason: str) -> None:
    part = printing(status=(0, int(status)))
    assert Master({"a": part}, [], step_ns=1, course=LayerCourse({"a": part})).run(time_max_ns=1) == reason


def test_time_of_a_failure_has_nine_digits() -> None:
    part = FunctionComponent(step=failing(1_234_567_890, lambda *_: {}, lambda: 1 / 0))
    with pytest.raises(ComponentError, match=r"^a failed at t = 1\.23456789 s: ZeroDivisionError"):
        Master({"a": part}, [], step_ns=1_234_567_890, course=None).run(time_max_ns=10**10)

"""The co-simulation master: order of execution, inputs and end of a run.

Time is whole nanoseconds. At every communication point each component has stepped as far as its rate requires, and the
observers see the newest outputs of all. Components are always terminated.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from functools import partial
from time import perf_counter_ns
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, Values
from inkloop.errors import ComponentError, ScenarioError, message_of
from inkloop.master.interrupt import deferred
from inkloop.master.pacing import Pacing
from inkloop.master.roles import Course, Observer, SavedPoint, StopReason
from inkloop.master.wiring import Connection, by_name, check, checked_output, feeds, initial_order, without_start
from inkloop.units import S_PER_NS

__all__ = ["Master", "Turns"]

Algorithm = Literal["gauss-seidel", "jacobi"]
Turns: TypeAlias = Generator[tuple[str, Values], None, StopReason]
"""Pauses before each step of a component: its name and its inputs; ends with the stop reason."""


class Master:
    """Runs connected components. Raises ScenarioError at once if the wiring has errors (see `wiring.check`).

    step_ns: distance of communication points. algorithm: "gauss-seidel" hands each component the newest outputs of
    those before it in the order of `components`; "jacobi" hands all of them the outputs of the last point.
    every: component -> whole number of master steps per own step, 1 if not named; its outputs hold in between.
    course: decides about values and the end; None: only the clock ends the run. pacing: waits for the clock after each
    step. on_end: called with reason, time and outputs when the run ends, before the components are terminated.
    """

    def __init__(
        self,
        components: Mapping[str, Component],
        connections: Sequence[Connection],
        *,
        step_ns: int,
        algorithm: Algorithm = "gauss-seidel",
        every: Mapping[str, int] | None = None,
        observers: Sequence[Observer] = (),
        course: Course | None = None,
        pacing: Pacing | None = None,
        on_end: Callable[[StopReason, int, Mapping[str, Values]], None] | None = None,
    ) -> None:
        errors = check(components, connections)
        errors += [
            f"{name}: every {count} steps; needs a whole number >= 1"
            for name, count in (every or {}).items()
            if count < 1
        ]
        if step_ns < 1:
            errors.append(f"step is {step_ns} ns; needs at least 1 ns")
        if errors:
            raise ScenarioError("connections", errors)
        self._components = dict(components)
        self._step_ns = step_ns
        self._jacobi = algorithm == "jacobi"
        self._every = {name: (every or {}).get(name, 1) for name in components}
        self._observers = tuple(observers)
        self._feeds = feeds(components, connections)
        self._course, self._pacing, self._on_end = course, pacing, on_end
        read = {connection.source for connection in connections}
        self._checked_ports = {
            name: [
                (port, port.name, port.shape, dtype, f"{name}.{port.name}" in read and dtype.kind == "f")
                for port in component.outputs
                for dtype in [np.dtype(port.dtype)]
            ]
            for name, component in components.items()
        }
        self._outputs: dict[str, Values] = {
            name: {port.name: port.start_value() for port in component.outputs}
            for name, component in components.items()
        }
        parts = (*components, "observers", *(["waiting"] if pacing else []), "total")
        self._wall_ns = dict.fromkeys(parts, 0)

    def run(self, *, time_max_ns: int | None = None, resume: SavedPoint | None = None) -> StopReason:
        """Initialize, step and terminate; returns the stop reason. Raises ComponentError.

        resume: the point to resume from, the start if None.
        "time_max": this time is over. "interrupted": Ctrl-C; all observers saw the last communication point. Any other
        is a reason of the course.
        """
        begin = perf_counter_ns()
        try:
            with ExitStack() as stack, deferred() as interrupted:
                turns = stack.enter_context(closing(self.turns(time_max_ns, resume, interrupted)))
                return _ended(turns)
        finally:
            self._wall_ns["total"] += perf_counter_ns() - begin

    def turns(
        self,
        time_max_ns: int | None = None,
        resume: SavedPoint | None = None,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> Turns:
        """The run of `run`, which pauses before each step of a component; to close it terminates the components."""
        endless = self._course.endless if self._course else "it has no course"
        if time_max_ns is None and endless:
            raise ScenarioError("run", [f"nothing ends this run: {endless}; set time_max_s"])
        with ExitStack() as stack:
            for name in self._components:
                stack.push(partial(self._terminate, name))
            self._initialize()
            time_ns = self._restore(resume) if resume else 0
            if self._course:
                self._course.begin(self._outputs)
            step = time_ns // self._step_ns
            self._observe("initialized", time_ns)
            if self._pacing:
                self._pacing.start(time_ns)
            while (reason := self._end(time_ns, time_max_ns, interrupted)) is None:
                time_ns += self._step_ns
                step += 1
                yield from self._step(time_ns, step)
                self._wait(time_ns, interrupted)
            if self._on_end:
                self._on_end(reason, time_ns, self._outputs)
            return reason

    def inputs(self, name: str, time_ns: int) -> Values:
        """Inputs of a component in a step that begins at `time_ns`, from the newest outputs."""
        return self._gather(name, self._outputs, time_ns)

    @property
    def wall_s(self) -> dict[str, float]:
        """Wall time [s] by component, of the observers, the master's own ("master") and in total ("total").

        For a paced run also the time spent waiting for the clock ("waiting").
        """
        *parts, total = self._wall_ns.values()
        return {name: ns * S_PER_NS for name, ns in self._wall_ns.items()} | {"master": (total - sum(parts)) * S_PER_NS}

    def _initialize(self) -> None:
        for name in initial_order(self._feeds):
            if reason := without_start(name, self._feeds, self._outputs):
                raise ComponentError(reason)
            begin = perf_counter_ns()
            try:
                outputs = self._components[name].initialize(0, self._gather(name, self._outputs, 0))
                self._publish(name, outputs, 0)
            except (Exception, SystemExit) as error:
                raise ComponentError(f"{name} could not be initialized: {message_of(error)}") from error
            self._wall_ns[name] += perf_counter_ns() - begin

    def _terminate(self, name: str, _kind: object, error: BaseException | None, _trace: object) -> None:
        """Terminate a component; a failure of it does not hide the error that ended the run."""
        try:
            self._components[name].terminate()
        except (Exception, SystemExit) as last:
            failure = f"{name} could not be terminated: {message_of(last)}"
            if not isinstance(error, Exception):
                raise ComponentError(failure) from last
            error.add_note(failure)

    def _restore(self, point: SavedPoint) -> int:
        """Bring the initialized components to a saved point; the time there."""
        for name, component in self._components.items():
            try:
                component.restore(point.states[name])  # type: ignore[attr-defined]
            except (Exception, SystemExit) as error:
                raise ComponentError(f"{name} could not be restored: {message_of(error)}") from error
        self._outputs = {name: dict(point.outputs[name]) for name in self._components}
        return point.time_ns

    def _step(self, time_ns: int, step: int) -> Iterator[tuple[str, Values]]:
        """Bring every component whose turn it is to `time_ns`, then inform the observers; pauses before each."""
        before = dict(self._outputs) if self._jacobi else self._outputs
        for name, component in self._components.items():
            if step % self._every[name]:
                continue
            own_step_ns = self._every[name] * self._step_ns
            begin_ns = time_ns - own_step_ns
            begin = perf_counter_ns()
            try:
                inputs = self._gather(name, before, begin_ns)
                yield name, inputs
                outputs = component.do_step(begin_ns, own_step_ns, inputs)
                self._publish(name, outputs, begin_ns)
            except (Exception, SystemExit) as error:
                place = self._course.place(self._outputs) if self._course else ""
                when = f"at t = {begin_ns * S_PER_NS:.9g} s{place and f', {place}'}"
                raise ComponentError(f"{name} failed {when}: {message_of(error)}") from error
            self._wall_ns[name] += perf_counter_ns() - begin
        self._observe("stepped", time_ns)

    def _observe(self, event: Literal["initialized", "stepped"], time_ns: int) -> None:
        begin = perf_counter_ns()
        for observer in self._observers:
            getattr(observer, event)(time_ns, self._outputs)
        self._wall_ns["observers"] += perf_counter_ns() - begin

    def _wait(self, time_ns: int, interrupted: Callable[[], bool]) -> None:
        if self._pacing:
            begin = perf_counter_ns()
            self._pacing.wait(time_ns, interrupted)
            self._wall_ns["waiting"] += perf_counter_ns() - begin

    def _gather(self, name: str, outputs: Mapping[str, Values], time_ns: int) -> Values:
        """The inputs of a step that begins at `time_ns`."""
        inputs = {port: transfer(outputs[source][output]) for port, source, output, transfer in self._feeds[name]}
        return self._course.inputs(name, inputs, time_ns, outputs) if self._course else inputs

    def _publish(self, name: str, outputs: Values, time_ns: int) -> None:
        """Let all components see the outputs of a step that began at `time_ns`."""
        checked = self._checked(name, outputs)
        self._outputs[name] = self._course.outputs(name, checked, time_ns, self._outputs) if self._course else checked

    def _checked(self, name: str, outputs: Values) -> Values:
        """The outputs as arrays of the declared shape and type; finite where another component reads them."""
        outputs, checked = by_name(outputs), dict[str, NDArray[Any]]()
        for port, key, shape, dtype, must_be_finite in self._checked_ports[name]:
            value = outputs.get(key)
            is_ready = type(value) is np.ndarray and value.dtype == dtype and value.shape == shape
            if value is None or not is_ready or value.flags.writeable or must_be_finite:
                value = checked_output(port, outputs, must_be_finite)
            checked[key] = value
        return checked

    def _end(self, time_ns: int, time_max_ns: int | None, interrupted: Callable[[], bool]) -> StopReason | None:
        """The reason why the run ends here, None if it does not."""
        if self._course and (reason := self._course.end(self._outputs)):
            return reason
        if time_max_ns is not None and time_ns >= time_max_ns:
            return "time_max"
        return "interrupted" if interrupted() else None


def _ended(turns: Turns) -> StopReason:
    """The stop reason of a run that is never paused."""
    while True:
        try:
            next(turns)
        except StopIteration as end:
            reason: StopReason = end.value
            return reason

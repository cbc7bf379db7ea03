"""The co-simulation master: order of execution, inputs and end of a run.

Time is whole nanoseconds. At every communication point each component has stepped as far as its rate requires, and the
observers see the newest outputs of all. Components are always terminated.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from math import isfinite
from time import perf_counter_ns
from typing import Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from inkloop.component import Component, Port, Status, Values
from inkloop.contract import (
    LAYER_COMMAND,
    LAYERS_PRINTED,
    LAYERS_SCANNED,
    LOOKED_AT,
    STATUS,
    STOP_REASON,
    has_port,
)
from inkloop.errors import ComponentError, ScenarioError, message_of
from inkloop.master.events import Event, Manipulator
from inkloop.master.interrupt import deferred
from inkloop.master.pacing import Pacing
from inkloop.master.wiring import Connection, check, feeds, without_start
from inkloop.results.checkpoint import Checkpoint
from inkloop.units import S_PER_NS

Algorithm = Literal["gauss-seidel", "jacobi"]
StopReason = Literal["done", "layers_max", "time_max", "fault", "interrupted", "stopped"]
Turns: TypeAlias = Generator[tuple[str, Values], None, StopReason]
"""Pauses before each step of a component: its name and its inputs; ends with the stop reason."""

_FAULT, _DONE = int(Status.FAULT), int(Status.DONE)


class Observer(Protocol):
    """Watches the run. The arrays are read-only views of what components gave; an observer copies what it keeps."""

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """All components are ready; `outputs` are those of the start time, by component."""

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        """A communication point has been reached."""


class Master:
    """Runs connected components. Raises ScenarioError at once if the wiring has errors (see `wiring.check`).

    step_ns: distance of communication points. algorithm: "gauss-seidel" hands each component the newest outputs of
    those before it in the order of `components`; "jacobi" hands all of them the outputs of the last point.
    every: component -> whole number of master steps per own step, 1 if not named; its outputs hold in between.
    events: changes to values between components, see `inkloop.master.events`. pacing: waits for the clock after each
    step. on_interrupt, on_stop: called with time and outputs when Ctrl-C, or the controller, ends a run that can be
    resumed, before the components are terminated.
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
        events: Sequence[Event] = (),
        pacing: Pacing | None = None,
        on_interrupt: Callable[[int, Mapping[str, Values]], None] | None = None,
        on_stop: Callable[[int, Mapping[str, Values]], None] | None = None,
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
        self._manipulator, self._has_events = Manipulator(events, components), bool(events)
        self._pacing, self._on_interrupt, self._on_stop = pacing, on_interrupt, on_stop
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
        commander = (name for name, part in components.items() if has_port(part.outputs, LAYER_COMMAND))
        self._commander = next(commander, None)
        can_be_told = self._commander and has_port(components[self._commander].inputs, LOOKED_AT)
        is_fed = any(connection.target == f"{self._commander}.{LOOKED_AT}" for connection in connections)
        self._told = self._commander if can_be_told and not is_fed else None  # gets `looked_at`
        self._is_looked_at = False
        parts = (*components, "observers", *(["waiting"] if pacing else []), "total")
        self._wall_ns = dict.fromkeys(parts, 0)

    def run(
        self, *, layers_max: int | None = None, time_max_ns: int | None = None, resume: Checkpoint | None = None
    ) -> StopReason:
        """Initialize, step and terminate; returns the stop reason. Raises ComponentError.

        resume: the point to resume from, the start if None.

        "done": the component that commands layers reports it. "stopped": its `stop_reason` is above 0: the scans do not
        show what was printed; to resume such a run says that a person has looked (`looked_at`). "layers_max": that many
        layers are printed, and scanned if a component scans. "fault": a component's status is fault. "interrupted":
        Ctrl-C; all observers saw the last communication point.
        """
        begin = perf_counter_ns()
        try:
            with ExitStack() as stack, deferred() as interrupted:
                turns = stack.enter_context(closing(self.turns(layers_max, time_max_ns, resume, interrupted)))
                return _ended(turns)
        finally:
            self._wall_ns["total"] += perf_counter_ns() - begin

    def turns(
        self,
        layers_max: int | None = None,
        time_max_ns: int | None = None,
        resume: Checkpoint | None = None,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> Turns:
        """The run of `run` as an iterator that pauses before each step of a component; closing it terminates the
        components.
        """
        if time_max_ns is None and not (layers_max is not None and self._find(LAYERS_PRINTED)):
            raise ScenarioError("run", ["nothing ends this run: no component counts layers; set time_max_s"])
        with ExitStack() as stack:
            for component in self._components.values():
                stack.callback(component.terminate)
            self._initialize()
            time_ns = self._restore(resume) if resume else 0
            self._is_looked_at = self._told is not None and self._is_stopped()
            step = time_ns // self._step_ns
            self._observe("initialized", time_ns)
            if self._pacing:
                self._pacing.start(time_ns)
            while (reason := self._end(time_ns, layers_max, time_max_ns)) is None:
                if interrupted():
                    if self._on_interrupt:
                        self._on_interrupt(time_ns, self._outputs)
                    return "interrupted"
                time_ns += self._step_ns
                step += 1
                yield from self._step(time_ns, step)
                self._wait(time_ns, interrupted)
            if reason == "stopped" and self._on_stop:
                self._on_stop(time_ns, self._outputs)
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
        order = self._initial_order()
        for k, name in enumerate(order):
            if reason := without_start(name, self._feeds, self._outputs, order[:k]):
                raise ComponentError(reason)
            begin = perf_counter_ns()
            try:
                outputs = self._components[name].initialize(0, self._gather(name, self._outputs, 0))
                self._publish(name, outputs, 0)
            except Exception as error:
                raise ComponentError(f"{name} could not be initialized: {message_of(error)}") from error
            self._wall_ns[name] += perf_counter_ns() - begin

    def _restore(self, checkpoint: Checkpoint) -> int:
        """Restore the initialized components to a checkpoint; returns its time."""
        for name, component in self._components.items():
            try:
                component.restore(checkpoint.states[name])  # type: ignore[attr-defined]
            except Exception as error:
                raise ComponentError(f"{name} could not be restored: {message_of(error)}") from error
            gc.collect(1)  # ctypes leaves states in reference cycles; the collector counts objects, not their bytes
        self._outputs = {name: dict(checkpoint.outputs[name]) for name in self._components}
        return checkpoint.time_ns

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
            except Exception as error:
                place = f"at t = {begin_ns * S_PER_NS:.9g} s{self._layer()}"
                raise ComponentError(f"{name} failed {place}: {message_of(error)}") from error
            self._is_looked_at = self._is_looked_at and name != self._told
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
        if name == self._told:
            inputs[LOOKED_AT] = np.asarray(self._is_looked_at)
        if not self._has_events:
            return inputs
        return self._manipulator.inputs(name, inputs, time_ns, self._commanded(outputs))

    def _publish(self, name: str, outputs: Values, time_ns: int) -> None:
        """Let all components see the outputs of a step that began at `time_ns`."""
        self._outputs[name] = self._checked(name, outputs)
        if not self._has_events:
            return
        self._outputs[name] = self._manipulator.outputs(
            name, self._outputs[name], time_ns, self._commanded(self._outputs)
        )

    def _commanded(self, outputs: Mapping[str, Values]) -> int:
        """Number of the last layer commanded, 0 if no component commands layers."""
        return int(outputs[self._commander][LAYER_COMMAND]) if self._commander else 0

    def _checked(self, name: str, outputs: Values) -> Values:
        """The outputs as arrays of the declared shape and type; finite where another component reads them."""
        checked: dict[str, NDArray[Any]] = {}
        before = self._outputs[name]
        for port, key, shape, dtype, must_be_finite in self._checked_ports[name]:
            value = outputs.get(key)
            if value is before[key] and isinstance(value.base, bytes):  # unchanged since it was checked
                checked[key] = value
                continue
            is_ready = type(value) is np.ndarray and value.dtype == dtype and value.shape == shape
            if value is None or not is_ready or value.flags.writeable or must_be_finite:
                value = checked_output(port, outputs, must_be_finite)
            checked[key] = value
        return checked

    def _initial_order(self) -> list[str]:
        """Sources before their targets; in a loop, the order of the scenario."""
        waiting = list(self._components)
        order = []
        while waiting:
            free = (n for n in waiting if not any(feed[1] in waiting and feed[1] != n for feed in self._feeds[n]))
            order.append(next(free, waiting[0]))
            waiting.remove(order[-1])
        return order

    def _end(self, time_ns: int, layers_max: int | None, time_max_ns: int | None) -> StopReason | None:
        for outputs in self._outputs.values():
            if STATUS in outputs and int(outputs[STATUS]) == _FAULT:
                return "fault"
        controller = self._find(LAYER_COMMAND)
        if controller and STATUS in controller and int(controller[STATUS]) == _DONE:
            return "done"
        if self._is_stopped() and not self._is_looked_at:
            return "stopped"
        counters = [part[count] for count in (LAYERS_PRINTED, LAYERS_SCANNED) if (part := self._find(count))]
        if layers_max is not None and counters and min(counters) >= layers_max:
            return "layers_max"
        return "time_max" if time_max_ns is not None and time_ns >= time_max_ns else None

    def _is_stopped(self) -> bool:
        """Whether the component that commands layers has ended the print."""
        return self._commander is not None and int(self._outputs[self._commander].get(STOP_REASON, 0)) > 0

    def _find(self, output: str) -> Values | None:
        """Outputs of the first component that has `output`."""
        for outputs in self._outputs.values():
            if output in outputs:
                return outputs
        return None

    def _layer(self) -> str:
        printer = self._find(LAYERS_PRINTED)
        return f", after layer {int(printer[LAYERS_PRINTED])}" if printer else ""


def _ended(turns: Turns) -> StopReason:
    """The stop reason of a run that is never paused."""
    while True:
        try:
            next(turns)
        except StopIteration as end:
            reason: StopReason = end.value
            return reason


def checked_output(port: Port, outputs: Values, must_be_finite: bool) -> NDArray[Any]:
    """Its value among `outputs`, read-only, in the declared shape and type. Raises ComponentError."""
    if port.name not in outputs:
        raise ComponentError(f"output {port.name} was declared but not returned")
    value = np.asarray(outputs[port.name])
    if value.shape != port.shape:
        raise ComponentError(f"output {port.name} has shape {value.shape}, declared {port.shape}")
    if value.dtype != port.dtype:
        if not np.can_cast(value.dtype, port.dtype, "same_kind"):
            raise ComponentError(f"output {port.name} is {value.dtype}, declared {port.dtype}")
        value = value.astype(port.dtype)
    if must_be_finite and not (np.isfinite(value).all() if value.shape else isfinite(value)):
        cell = tuple(int(i) for i in np.argwhere(~np.isfinite(value))[0])
        raise ComponentError(
            f"output {port.name} is {value[cell]} in cell {cell}" if cell else f"output {port.name} is {value}"
        )
    if value.flags.writeable:
        value = value.view()
        value.flags.writeable = False  # consumers share it
    return value

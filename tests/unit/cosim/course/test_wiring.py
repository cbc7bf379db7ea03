"""The loop of the layer contract is wired by the names of its ports; what must not stay open is named."""

from __future__ import annotations

import numpy as np
import pytest

from inkloop.component import Port
from inkloop.course.events import Event
from inkloop.course.layer_course import LayerCourse, contract_connections, open_inputs
from inkloop.master.wiring import Connection, check
from support.toys import FunctionComponent, toy_job, toy_loop


class Follower(FunctionComponent):
    is_shadow = True


class Modest(FunctionComponent):
    optional_inputs = frozenset({"pattern"})


def test_contract_wires_the_loop_completely() -> None:
    parts = toy_loop(toy_job())
    wires = contract_connections(parts)
    assert len(wires) == sum(len(part.inputs) for part in parts.values())
    assert Connection("controller.pattern", "printer.pattern") in wires
    assert [*check(parts, wires), *open_inputs(parts, wires)] == []
    assert contract_connections({"a": FunctionComponent(inputs=[Port("y")], outputs=[Port("y")])}) == []


def test_printer_goes_before_its_shadow() -> None:
    loop = toy_loop(toy_job())
    follower = Follower(outputs=[*loop["printer"].outputs, Port("layers_followed", dtype="int32")])
    parts = {"shadow": follower, **loop}
    assert Connection("printer.height", "profiler.height") in contract_connections(parts)
    del parts["printer"]
    wires = contract_connections(parts)
    assert Connection("shadow.height", "profiler.height") in wires
    assert Connection("shadow.layers_followed", "profiler.layers_printed") in wires
    assert Connection("shadow.layers_followed", "controller.layers_printed") not in wires


@pytest.mark.parametrize(
    ("port", "giver"),
    [
        ("layer_command", 'a controller, e.g. [components.controller] with kind = "LayerMpc"'),
        ("layers_printed", 'a printer, e.g. [components.printer] with kind = "LayerDeposition"'),
        ("layers_scanned", 'a profiler, e.g. [components.profiler] with kind = "ProfileSensor"'),
    ],
)
def test_open_input_is_answered_with_who_gives_it(port: str, giver: str) -> None:
    part = FunctionComponent(inputs=[Port(port, dtype="int32"), Port("speed")])
    (error,) = open_inputs({"part": part}, [])
    assert error.endswith(f"add {giver}, or name a source under [[connections]]")


def test_end_of_a_print_is_that_of_its_controller_for_any_reason_above_none() -> None:
    ports = [Port(name, dtype="int32") for name in ("layer_command", "stop_reason", "status")]
    course = LayerCourse({"controller": FunctionComponent(outputs=ports)})
    for reason, end in ((0, None), (1, "stopped"), (64, "stopped")):
        values = {"layer_command": np.asarray(2), "stop_reason": np.asarray(reason), "status": np.asarray(0)}
        assert course.end({"controller": values}) == end


def test_event_on_the_controller_begins_with_the_outputs_that_command_its_layer() -> None:
    controller = FunctionComponent(outputs=[Port("pattern", shape=(2, 3)), Port("layer_command", dtype="int32")])
    events = [Event("controller.pattern", "override", at_layer=2, value=np.asarray(0.0))]
    course = LayerCourse({"controller": controller}, events=events)
    before = {"controller": {"pattern": np.ones((2, 3)), "layer_command": np.asarray(1)}}
    for layer, dots in ((1, 1.0), (2, 0.0)):
        values = {"pattern": np.ones((2, 3)), "layer_command": np.asarray(layer)}
        assert (course.outputs("controller", values, 0, before)["pattern"] == dots).all()


def test_open_input_is_asked_about_unless_its_component_calls_it_optional() -> None:
    parts = toy_loop(toy_job()) | {"other": toy_loop(toy_job())["printer"]}
    errors = list(open_inputs(parts, contract_connections(parts)))
    assert "profiler.height may come from printer.height or other.height; choose one under [[connections]]" in errors
    ports = [Port("pattern", "1", (2, 3), "int32"), Port("layer_command", dtype="int32"), Port("speed", "m/s")]
    of_pattern, of_command = open_inputs({"printer": FunctionComponent(inputs=ports)}, [])
    assert of_pattern.startswith("printer.pattern is not connected: no other component has an output pattern")
    assert list(open_inputs({"printer": Modest(inputs=ports)}, [])) == [of_command]
    assert of_command == (
        "printer.layer_command is not connected: no other component has an output layer_command; "
        'add a controller, e.g. [components.controller] with kind = "LayerMpc", or name a source under [[connections]]'
    )

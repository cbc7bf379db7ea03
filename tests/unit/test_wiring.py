from __future__ import annotations

import pytest

from inkloop.component import Port
from inkloop.wiring import Connection, check, contract_connections
from toys import FunctionComponent, toy_job, toy_loop


def test_contract_wires_the_loop_completely() -> None:
    parts = toy_loop(toy_job())
    wires = contract_connections(parts)
    assert len(wires) == sum(len(part.inputs) for part in parts.values())
    assert Connection("controller.pattern", "printer.pattern") in wires
    assert check(parts, wires) == []


def test_input_with_two_possible_sources_is_asked_about() -> None:
    job = toy_job()
    parts = toy_loop(job) | {"shadow": toy_loop(job)["printer"]}
    faults = check(parts, contract_connections(parts))
    assert "profiler.height may come from printer.height or shadow.height; say which under [[connections]]" in faults


def test_missing_contract_input_is_a_fault_and_any_other_open_input_is_not() -> None:
    parts = {
        "printer": FunctionComponent(inputs=[Port("pattern", "1", (2, 2), "int32")]),
        "fan": FunctionComponent(inputs=[Port("speed", "m/s")]),
    }
    (fault,) = check(parts, [])
    assert fault.startswith("printer.pattern is not connected: no other component has an output pattern")


@pytest.mark.parametrize(
    ("port", "said"),
    [
        (Port("y", "s"), "a.y gives [s], b.x takes [m]: same quantity needed"),
        (Port("y", "m", (3,)), "a.y gives 3, b.x takes a scalar"),
        (Port("y", "m", dtype="int32"), "a.y gives int32, b.x takes float64"),
    ],
)
def test_mismatch_is_named_with_both_sides(port: Port, said: str) -> None:
    parts = {"a": FunctionComponent(outputs=[port]), "b": FunctionComponent(inputs=[Port("x", "m")])}
    (fault,) = check(parts, [Connection("a.y", "b.x")])
    assert fault.startswith(said)


@pytest.mark.parametrize(
    ("connection", "said"),
    [
        (Connection("aa.y", "b.x"), "aa.y: there is no component 'aa'; did you mean a?"),
        (Connection("a.yy", "b.x"), "a.yy: a has no output 'yy'; did you mean y?"),
        (Connection("a.y", "b.xx"), "b.xx: b has no input 'xx'; did you mean x?"),
        (Connection("b.y", "b.x"), "b.y: b has no output 'y'; it has no outputs"),
    ],
)
def test_unknown_end_is_answered_with_the_nearest_known(connection: Connection, said: str) -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y")]), "b": FunctionComponent(inputs=[Port("x")])}
    assert check(parts, [connection]) == [said]


def test_input_is_fed_once() -> None:
    parts = {"a": FunctionComponent(outputs=[Port("y"), Port("z")]), "b": FunctionComponent(inputs=[Port("x")])}
    (fault,) = check(parts, [Connection("a.y", "b.x"), Connection("a.z", "b.x")])
    assert fault.startswith("b.x is fed twice, by a.y and a.z")

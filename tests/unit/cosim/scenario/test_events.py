from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.component import Port, Values
from inkloop.course.events import Event, Manipulator
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import ScenarioError
from inkloop.master.master import Algorithm, Master
from inkloop.results.recorder import Recorder
from inkloop.scenario.events import read_events
from inkloop.scenario.file import Scenario
from inkloop.tables.schema import EventTable
from support.places import SCENARIOS
from support.toys import DROPLET, FunctionComponent, toy_job, toy_loop

CUBOID = (SCENARIOS / "cuboid.toml").read_text()
SECOND = 1_000_000_000
PARTS = {"a": FunctionComponent(inputs=[Port("x", start=1.0)], outputs=[Port("y", "m", (2, 3))])}


def number(value: float) -> np.ndarray:
    return np.asarray(value)


def seen(events: list[Event], layer: int, time_ns: int = 0) -> float:
    """Value of `a` at its open input x, whose start value is 1."""
    return float(Manipulator(events, PARTS).inputs("a", {}, time_ns, layer)["x"])


def test_only_the_chosen_cells_change_and_the_source_keeps_its_array() -> None:
    cells = np.zeros((2, 3), dtype=np.bool_)
    cells[1, 2] = True
    events = [
        Event("a.y", "override", at_layer=1, value=number(5.0)),
        Event("a.y", "reset", at_layer=1, cells=~cells),
    ]
    given = np.ones((2, 3))
    changed = Manipulator(events, PARTS).outputs("a", {"y": given}, 0, 1)["y"]
    np.testing.assert_array_equal(changed, np.where(cells, 5.0, 1.0))
    np.testing.assert_array_equal(given, np.ones((2, 3)))
    assert not changed.flags.writeable
    unchanged = Manipulator(events, PARTS).outputs("a", {"y": given}, 0, 0)["y"]
    np.testing.assert_array_equal(unchanged, given)
    assert (unchanged.flags.writeable, given.flags.writeable) == (False, True)


def test_layers_count_as_modified_until_every_cell_is_reset() -> None:
    half = np.zeros((2, 3), dtype=np.bool_)
    half[0] = True
    events = [
        Event("a.y", "override", at_layer=2, value=number(5.0)),
        Event("a.y", "reset", at_layer=4, cells=half),
        Event("a.y", "reset", at_layer=6, cells=~half),
    ]
    manipulator = Manipulator(events, PARTS)
    assert [manipulator.in_effect(0, layer) for layer in range(1, 7)] == [False, True, True, True, True, False]


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("durations", [(0, 0), (2 * SECOND, 3 * SECOND)])
def test_event_begins_with_its_layer_whatever_the_master(algorithm: Algorithm, durations: tuple[int, int]) -> None:
    """The droplets of cell (1, 0) are lost in layers 2 and 3, which the toy controller makes up for at the end."""
    job = toy_job(layers=4)
    parts = toy_loop(job, *durations)
    cell = np.zeros((job.nx, job.ny), dtype=np.bool_)
    cell[1, 0] = True
    none = np.asarray(0, dtype=np.int32)
    events = [
        Event("printer.pattern", "override", at_layer=2, value=none, cells=cell),
        Event("printer.pattern", "reset", at_layer=4),
    ]
    recorder = Recorder(job, parts)
    wires = contract_connections(parts)
    master = Master(
        parts,
        wires,
        step_ns=SECOND,
        algorithm=algorithm,
        observers=[recorder],
        course=LayerCourse(parts, layers_max=20, events=events),
    )
    assert master.run() == "done"
    height = recorder.dataset().height.values / DROPLET
    np.testing.assert_allclose(height[:, 1, 0], [0, 1, 1, 1, 2, 3, 4])
    np.testing.assert_allclose(height[:, 1, 1], [0, 1, 2, 3, 4, 4, 4])


def test_all_components_and_the_record_see_a_changed_output() -> None:
    job = toy_job(layers=2)
    parts = toy_loop(job)
    height = np.full((job.nx, job.ny), DROPLET)
    events = [Event("profiler.measured_height", "bias", at_layer=1, value=height)]
    recorder = Recorder(job, parts)
    Master(
        parts,
        contract_connections(parts),
        step_ns=1,
        observers=[recorder],
        course=LayerCourse(parts, layers_max=9, events=events),
    ).run()
    result = recorder.dataset()
    assert result.sizes["layer"] == 2
    np.testing.assert_allclose(result.measured_height[1] - result.height[1], DROPLET)
    np.testing.assert_array_equal(result.estimated_height[1], result.measured_height[1])


def load(tmp_path: Path, events: str, **grid: int) -> Scenario:
    path = tmp_path / "events.toml"
    printer = 'kind = "LayerDeposition"\nnozzle_pitch = 4'
    path.write_text(CUBOID.replace('kind = "LayerDeposition"', printer) + events)
    return Scenario.load(path, {f"grid.{edge}": count for edge, count in grid.items()})


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('port = "printer.pattern"\nvalue = 0', "at_layer, at_time_s: neither is given; give one of them"),
        ('at_layer = 1\nat_time_s = 1.0\nport = "printer.pattern"\nvalue = 0', "at_layer, at_time_s: both are given"),
        ('at_layer = 0\nport = "printer.pattern"\nvalue = 0', "at_layer is 0; expected greater than or equal to 1"),
        ('at_layer = 1\nport = "printer.patern"\nvalue = 0', "printer has no port 'patern'; did you mean pattern?"),
        ('at_layer = 1\nport = "printr.pattern"\nvalue = 0', "no component 'printr'; did you mean printer?"),
        ('at_layer = 1\nport = "printer.pattern"', "value is missing; add what to override printer.pattern with"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0.5', "value is 0.5; expected a whole number"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = [0, 1]', "value has shape (2,); printer.pattern takes"),
        (
            'at_layer = 1\nport = "printer.pattern"\nvalue = [0]',
            "value has shape (1,); printer.pattern takes a number or",
        ),
        ('at_layer = 1\nport = "printer.height"\nvalue_um = true', "value_um is True; expected a finite number"),
        ('at_layer = 1\nport = "printer.height"\nvalue = 1.0', "value is a length; write value_um"),
        ('at_layer = 1\nport = "printer.height"\nvalue_um = inf', "value_um is inf; expected a finite number"),
        ('at_layer = 1\nport = "printer.height"\nvalue_um = [1.5, nan]', "value_um is [1.5, nan]; expected a finite"),
        ('at_layer = 1\nport = "profiler.valid"\nvalue = 0', "value is 0; expected true or false"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0\ncells = [[12, 0]]', "cells has [12, 0]; the grid of"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0\ncells = [[0, -1]]', "cells has [0, -1]; the grid of"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0\nnozzles = [4]', "nozzles has 4; expected 0 to 3"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0\nnozzles = [-1]', "nozzles has -1; expected 0 to 3"),
        (
            'at_layer = 1\nport = "profiler.valid"\nvalue = false\nnozzles = [1]',
            "profiler does not declare their number",
        ),
        ('at_layer = 1\nport = "printer.layer_command"\nvalue = 0\ncells = [[0, 0]]', "has no cells"),
        ('at_layer = 1\nport = "printer.pattern"\nvalue = 0\ntilt_x = 0.1', "tilt_x and tilt_y are of a bias"),
        (
            'at_layer = 1\nport = "printer.pattern"\nvalue = 0\ncell = 1',
            "cell is not a key of this table; did you mean",
        ),
    ],
)
def test_error_of_an_event_is_named_with_its_place(tmp_path: Path, table: str, message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, f'\n[[events]]\naction = "override"\n{table}\n')
    (error,) = caught.value.errors
    assert error.startswith("events.[0].")
    assert message in error


def test_errors_of_all_events_come_at_once(tmp_path: Path) -> None:
    wrong = '\n[[events]]\nat_layer = 1\naction = "bias"\nport = "profiler.valid"\nvalue = true\nnozzles = [0]\n'
    late = '\n[[events]]\nat_time_s = 1.0\naction = "bias"\nport = "printer.height"\nper_layer_um = 1.0\n'
    with pytest.raises(ScenarioError) as caught:
        load(tmp_path, wrong + late)
    assert [error.split(" ")[0] for error in caught.value.errors] == [
        "events.[0].action",
        "events.[0].nozzles:",
        "events.[1].per_layer",
    ]


def test_event_of_a_file_comes_in_the_unit_of_its_port_and_for_its_cells(tmp_path: Path) -> None:
    scenario = load(
        tmp_path,
        '\n[[events]]\nat_layer = 2\naction = "override"\nport = "printer.pattern"\nvalue = 0\nnozzles = [1]\n'
        'cells = [[3, 4], [5, 1]]\n\n[[events]]\nat_time_s = 1.001\naction = "bias"\nport = "printer.height"\n'
        "value_um = 3\ntilt_x = 0.01\ntilt_y = -0.03\n",
        ny=13,
    )
    dead, tilted = scenario.events
    assert dead.cells is not None
    assert np.flatnonzero(dead.cells.all(axis=0)).tolist() == [1, 5, 9]
    assert dead.cells[3, 4]
    assert dead.cells.sum() == 3 * 12 + 1
    assert tilted.value is not None
    assert tilted.at_time_ns == 1001 * SECOND // 1000
    assert tilted.value.mean() == pytest.approx(3e-6, rel=1e-9, abs=0.0)
    np.testing.assert_allclose(np.diff(tilted.value, axis=0), 0.01 * 263.256e-6)
    np.testing.assert_allclose(np.diff(tilted.value, axis=1), -0.03 * 263.256e-6)


def test_tilt_of_a_port_is_in_its_unit_and_stands_in_the_middle_of_its_map() -> None:
    """A slope of one half over cells of a millimetre."""
    part = FunctionComponent(outputs=[Port("top", "mm", (2, 3))])
    table = EventTable(at_time_s=0.0, action="bias", port="a.top", tilt_y=0.5)
    (event,), errors = read_events([table], {"a": part}, {}, 1e-3)
    assert errors == []
    assert event.value is not None
    np.testing.assert_allclose(event.value, [[-0.5, 0.0, 0.5]] * 2, rtol=0.0, atol=1e-12)


def test_component_of_a_manipulated_input_never_knows() -> None:
    got: list[Values] = []

    def keep(time_ns: int, step_ns: int, inputs: Values) -> Values:
        got.append(inputs)
        return {}

    sink = FunctionComponent(inputs=[Port("x", start=2.0), Port("z")], step=keep)
    events = [Event("a.x", "bias", at_time_ns=1, value=number(0.5))]
    Master({"a": sink}, [], step_ns=1, course=LayerCourse({"a": sink}, events=events)).run(time_max_ns=3)
    assert [float(inputs["x"]) for inputs in got] == [2.0, 2.5, 2.5]
    assert all(set(inputs) == {"x"} for inputs in got)


HALF = np.array([[True, False, False], [True, True, False]])


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (Event("a.y", "override", at_layer=2, value=number(5.0)), "from layer 2: override a.y 5"),
        (
            Event("a.y", "bias", at_time_ns=1_500_000_000, value=np.array([[1.5, -2.0, 0.0]]), cells=HALF),
            "from t = 1.5 s: bias a.y -2 .. 1.5 in 3 cells",
        ),
        (
            Event("a.y", "bias", at_layer=3, value=number(1.0), per_layer=number(0.25)),
            "from layer 3: bias a.y 1, 0.25 more with each further layer",
        ),
        (Event("a.y", "reset", at_layer=4), "from layer 4: reset a.y"),
        (Event("a.y", "bias", at_layer=1, value=np.array([0.0, 2.5])), "from layer 1: bias a.y 0 .. 2.5"),
    ],
)
def test_event_is_told_with_its_begin_place_values_and_cells(event: Event, text: str) -> None:
    assert str(event) == text


def test_event_acts_on_the_input_of_two_ports_of_one_name_and_keeps_the_type_of_the_port() -> None:
    part = FunctionComponent([Port("z", dtype="int32", start=1)], [Port("z")])
    manipulator = Manipulator([Event("a.z", "bias", at_layer=1, value=number(2.0))], {"a": part})
    found = manipulator.inputs("a", {"z": np.asarray(4, np.int32)}, 0, 1)["z"]
    assert (int(found), found.dtype) == (6, np.int32)
    given: Values = {"z": number(4.0)}
    assert manipulator.outputs("a", given, 0, 1) is given


OVERRIDE = Event("a.x", "override", at_layer=2, value=number(10.0))
BIAS = Event("a.x", "bias", at_layer=3, value=number(0.5))


@pytest.mark.parametrize(
    ("events", "moments", "expected"),
    [
        ([OVERRIDE, BIAS, Event("a.x", "reset", at_layer=4)], [(1,), (2,), (3,), (4,)], [1.0, 10.0, 10.5, 1.0]),
        ([BIAS, OVERRIDE], [(3,)], [10.0]),  # the order of the file counts
        ([BIAS, BIAS], [(3,)], [2.0]),
        ([Event("a.x", "override", at_time_ns=5, value=number(7.0))], [(0, 4), (0, 5), (0, 6)], [1.0, 7.0, 7.0]),
        (
            [Event("a.x", "bias", at_layer=3, value=number(1.0), per_layer=number(0.25))],
            [(2,), (3,), (4,), (5,), (5, 9)],
            [1.0, 2.0, 2.25, 2.5, 2.5],
        ),
    ],
)
def test_events_act_from_their_layer_or_time_on(events: list[Event], moments: list[Any], expected: list[float]) -> None:
    assert [seen(events, *moment) for moment in moments] == expected

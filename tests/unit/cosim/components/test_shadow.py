"""A shadow deposits what the device reports as printed, and reports scans that grow differently."""

from __future__ import annotations

import io
import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import permutations
from typing import Any

import numpy as np
import pytest

from inkloop.component import Component, Job, Port, Status, Values
from inkloop.components import catalog
from inkloop.components.kind import Bench
from inkloop.components.shadow import ScannedLayer, Shadow, start_surface
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.errors import ComponentError, ScenarioError
from inkloop.master.master import Algorithm, Master
from inkloop.master.wiring import check
from inkloop.testing import RESUMABLE_CONTRACT_CHECKS, ContractCheck
from inkloop.testing import job as small_job
from support.benches.device_toys import DevicePrinter, DeviceProfiler, StartingPrinter
from support.toys import DROPLET, FunctionComponent, ToyController, ToyProfiler, toy_job

SECOND = 1_000_000_000
ORDERS = list(permutations(("controller", "printer", "shadow", "profiler")))


class Watch:
    """Keeps what a shadow reports whenever it has compared a layer; its height when it has followed one."""

    def __init__(self, printer: DevicePrinter) -> None:
        self.printer = printer
        self.growth: dict[int, float] = {}
        self.surface: dict[int, float] = {}
        self.status: dict[int, int] = {}
        self.last: Values = {}

    def initialized(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.stepped(time_ns, outputs)

    def stepped(self, time_ns: int, outputs: Mapping[str, Values]) -> None:
        self.last = outputs["shadow"]
        layer = int(self.last["layers_compared"])
        self.growth[layer] = float(self.last["growth_divergence"])
        self.surface[layer] = float(self.last["surface_divergence"])
        self.status[layer] = int(self.last["status"])


def rig(
    job: Job, durations: tuple[int, int] = (0, 0), plate: np.ndarray | None = None, **limits: Any
) -> dict[str, Any]:
    """Controller, device printer, its shadow, and a profiler of what lies on the bed."""
    printer = DevicePrinter(job, durations[0], plate)
    return {
        "controller": ToyController(job),
        "printer": printer,
        "shadow": Shadow(job, StartingPrinter, **limits),
        "profiler": DeviceProfiler(job, printer, durations[1]),
    }


def run(parts: dict[str, Any], algorithm: Algorithm = "gauss-seidel", layers: int = 9) -> tuple[Watch, str]:
    watch = Watch(parts["printer"])
    wires = contract_connections(parts)
    assert check(parts, wires) == []
    master = Master(
        parts,
        wires,
        step_ns=SECOND,
        algorithm=algorithm,
        observers=[watch],
        course=LayerCourse(parts, layers_max=layers),
    )
    return watch, master.run(time_max_ns=1000 * SECOND)


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
@pytest.mark.parametrize("start", ["scan", "job"])
def test_shadow_keeps(check: ContractCheck, start: str) -> None:
    check(lambda: catalog.make("Shadow", small_job(), {"start": start, "variation": 0.2}))


@pytest.mark.parametrize("check", RESUMABLE_CONTRACT_CHECKS)
def test_shadow_of_any_plant_keeps(check: ContractCheck) -> None:
    check(lambda: Shadow(small_job(), StartingPrinter))


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_shadow_of_a_rig_that_does_as_the_model_never_diverges(order: tuple[str, ...], algorithm: Algorithm) -> None:
    """Whatever the order of the components, the algorithm and the durations; the plate is not flat."""
    job = toy_job()
    plate = np.linspace(0.0, 30e-6, 12).reshape(4, 3)
    for durations in ((0, 0), (3 * SECOND, 0), (0, 2 * SECOND)):
        parts = rig(job, durations, plate)
        watch, reason = run({name: parts[name] for name in order}, algorithm)
        assert reason == "done"
        assert max(watch.growth) >= 3
        assert max(value for layer, value in watch.growth.items() if layer > 0) < 1e-15
        assert max(value for layer, value in watch.surface.items() if layer >= 0) < 1e-15
        assert set(watch.status.values()) == {Status.IDLE}
        if order.index("shadow") > order.index("printer"):  # before it, the run may end when it is a step behind
            np.testing.assert_allclose(watch.last["height"], parts["printer"].surface, atol=1e-15)


class GivingUpPrinter(DevicePrinter):
    """Gives layer 2 up after half of its lines, and reports it."""

    def __init__(self, job: Job) -> None:
        super().__init__(job)
        self.outputs = (*self.outputs, Port("layer_unknown", dtype="bool"))
        self.disturb = lambda layer, pattern: pattern * ((np.indices(pattern.shape)[0] < 2) | (layer != 2))

    def _reported(self, values: Values) -> Values:
        return super()._reported({**values, "layer_unknown": np.asarray(values["layers_printed"] == 2)})


def test_shadow_continues_from_the_scan_of_a_layer_that_was_given_up() -> None:
    job = toy_job()
    printer = GivingUpPrinter(job)
    parts = {**rig(job, stop=1e-6), "printer": printer, "profiler": DeviceProfiler(job, printer)}
    watch, reason = run(parts)
    assert reason == "done", "the shadow would have stopped the run"
    assert {layer for layer, status in watch.status.items() if status != Status.IDLE} == {2}
    assert np.isnan(watch.growth[2])
    later = [value for layer, value in watch.surface.items() if layer > 2]
    assert later
    assert max(later) < 1e-15


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
@pytest.mark.parametrize("order", ORDERS, ids=" ".join)
def test_simulated_sensor_scans_each_layer_of_the_shadow_of_a_device(
    order: tuple[str, ...], algorithm: Algorithm
) -> None:
    """Never the surface before it, whatever stands where."""
    job = toy_job()
    parts = rig(job, start="job") | {"profiler": ToyProfiler(job)}
    watch, reason = run({name: parts[name] for name in order}, algorithm)
    assert reason == "done"
    assert max(watch.surface) >= 3
    assert max(value for layer, value in watch.surface.items() if layer >= 0) < 1e-15


def inputs(job: Job, command: int, printed: int, dots: int, scan: Values | None = None) -> Values:
    return {
        "pattern": np.full((job.nx, job.ny), dots, np.int32),
        "layer_command": np.asarray(command),
        "layers_printed": np.asarray(printed),
        **(scan or {}),
    }


def scan(layer: int, height: np.ndarray, valid: np.ndarray | bool = True) -> Values:
    marks = np.broadcast_to(valid, height.shape)
    return {"layers_scanned": np.asarray(layer), "measured_height": height, "valid": marks}


def test_cells_that_were_not_seen_twice_do_not_count() -> None:
    part = np.array([[True, True, True, False]])
    surface = np.zeros((1, 4))
    before = ScannedLayer(np.array([[0.0, 7.0, 0.0, 0.0]]), np.array([[True, False, True, True]]), surface)
    after = ScannedLayer(np.array([[3.0, 5.0, 9.0, 50.0]]), np.array([[True, True, False, True]]), surface)
    found = after.divergence(before, part)
    assert found.growth == 3.0
    assert found.surface == pytest.approx(np.sqrt((9 + 25) / 2), rel=1e-9, abs=0.0)


def test_layer_that_was_not_jetted_is_logged_once_and_its_run_continues(caplog: pytest.LogCaptureFixture) -> None:
    job = toy_job()
    parts = rig(job, alarm=DROPLET / 2, stop=1.01 * DROPLET)
    parts["printer"].disturb = lambda layer, pattern: 0 * pattern if layer == 2 else pattern
    with caplog.at_level(logging.WARNING):
        watch, reason = run(parts)
    assert reason == "done"
    assert [layer for layer, status in watch.status.items() if status] == [2]
    assert watch.growth[2] == pytest.approx(DROPLET, rel=1e-9, abs=0.0)
    assert watch.surface[4] == pytest.approx(DROPLET, rel=1e-9, abs=0.0)
    message = [record.getMessage() for record in caplog.records]
    assert message == [
        "layer 2 grew differently from the model, by 10.00 µm rms over the part; more than alarm_um = 5. "
        "Look at the print head and at the scan"
    ]


def test_layer_beyond_the_stop_limit_ends_the_run(caplog: pytest.LogCaptureFixture) -> None:
    parts = rig(toy_job(), alarm=DROPLET / 4, stop=0.99 * DROPLET)
    parts["printer"].disturb = lambda layer, pattern: 0 * pattern if layer == 3 else pattern
    watch, reason = run(parts)
    assert reason == "fault"
    assert watch.status == {-1: 0, 0: 0, 1: 0, 2: 0, 3: Status.FAULT}
    assert "layer 3 grew differently" in caplog.text
    assert "stop_um = 9.9: the run ends" in caplog.text


def test_layer_of_which_nothing_can_be_compared_is_untrusted(caplog: pytest.LogCaptureFixture) -> None:
    parts = rig(toy_job())
    parts["profiler"].blind = np.ones((4, 3), np.bool_)
    watch, _ = run(parts, layers=3)
    assert watch.status[0] == Status.IDLE
    assert watch.status[1] == watch.status[2] == Status.UNTRUSTED
    assert "layer 1: no cell of the part was seen in its scan and in the one before" in caplog.text


def heap(job: Job) -> Component:
    """A plant without the handshake."""
    shape = (job.nx, job.ny)
    kept = np.zeros(shape)

    def step(time_ns: int, step_ns: int, values: Values) -> Values:
        np.add(kept, DROPLET * values["dots"], out=kept)
        return {"top": kept}

    return FunctionComponent([Port("dots", shape=shape)], [Port("top", "m", shape)], step)


def test_plant_without_the_handshake_is_stepped_layer_by_layer(caplog: pytest.LogCaptureFixture) -> None:
    job = toy_job()
    options = {"plant": f"{__name__}:heap", "pattern_input": "dots", "height_output": "top"}
    shadow = catalog.make("Shadow", job, options)
    ones = np.ones((job.nx, job.ny))
    shadow.initialize(0, inputs(job, 0, 0, 0))
    shadow.do_step(0, SECOND, inputs(job, 0, 0, 0, scan(0, 5e-6 * ones)))
    outputs = shadow.do_step(SECOND, SECOND, inputs(job, 1, 1, 1, scan(1, (5e-6 + DROPLET) * ones)))
    assert "the plant takes no start surface" in caplog.text
    assert float(outputs["growth_divergence"]) == pytest.approx(0.0, abs=1e-15)
    assert float(outputs["surface_divergence"]) == pytest.approx(5e-6, rel=1e-9, abs=0.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"plant": "Shadow"}, "plant is 'Shadow'; expected a deposition model"),
        ({"plant": "ProfileSensor"}, "pattern_input is 'pattern', which the plant does not have"),
        ({"plant": "Nowhere"}, "kind is 'Nowhere'; known: "),
        ({"alarm_um": 0.0}, "alarm_um is 0.0; expected"),
        ({"start": "flat"}, "start is 'flat'; expected 'scan' or 'job'"),
        ({"variaton": 0.1}, "variaton is no option of LayerDeposition; did you mean variation?"),
        ({"plant": "Fmu", "file": "none.fmu"}, "file: none.fmu: cannot be read"),
    ],
)
def test_error_of_the_options_is_reported(options: dict[str, object], message: str) -> None:
    errors = catalog.check("Shadow", small_job(), options).errors
    assert any(error.startswith(message) for error in errors), errors
    with pytest.raises(ScenarioError):
        catalog.make("Shadow", small_job(), options)


def test_plant_that_cannot_be_followed_is_named() -> None:
    job = toy_job()
    made: Callable[[Job], Component] = lambda job: FunctionComponent([Port("layer_command")], [])  # noqa: E731
    with pytest.raises(ValueError, match="plant has no pattern, height, layers_printed; needs those of the layer"):
        Shadow(job, made)


@pytest.mark.parametrize(
    ("height", "found"),
    [
        (Port("height", "mm", (4, 3)), r"height of shape \(4, 3\) in \[mm\]"),
        (Port("height", "m", (3, 4)), r"height of shape \(3, 4\) in \[m\]"),
    ],
)
def test_plant_of_another_surface_is_refused_and_terminated(height: Port, found: str) -> None:
    plant = FunctionComponent([Port("pattern"), Port("layer_command")], [height, Port("layers_printed")])
    with pytest.raises(ValueError, match=rf"plant has {found}; needs \(4, 3\) in \[m\]"):
        Shadow(toy_job(), lambda job: plant)
    assert plant.log == ["terminate"]


def begun(job: Job, *given: Any) -> tuple[Shadow, Values]:
    """A shadow after initialization."""
    shadow = Shadow(job, StartingPrinter)
    return shadow, shadow.initialize(0, inputs(job, 0, 0, 0, *given))


def test_layer_is_deposited_when_the_printer_reports_it_with_the_pattern_of_its_command() -> None:
    """Also without a profiler; until a scan is compared the divergences are unknown."""
    job = toy_job()
    shadow, first = begun(job)
    starts = {port.name: port.start_value() for port in shadow.outputs}
    for name in ("growth_divergence", "surface_divergence"):
        assert np.isnan([starts[name], first[name]]).all()
    given = [(1, 0, 1), (1, 0, 0), (1, 1, 0), (2, 2, 1)]  # command, printed, the pattern input meanwhile
    found = [shadow.do_step(k * SECOND, SECOND, inputs(job, *row)) for k, row in enumerate(given)]
    assert [values["height"].max() for values in found] == [0.0, 0.0, DROPLET, 2 * DROPLET]
    assert [int(values["layers_followed"]) for values in found] == [0, 0, 1, 2]
    assert int(found[-1]["layers_compared"]) == -1


@pytest.mark.parametrize(
    ("layers", "last", "growth", "surface"), [((0, 0, 0, 0), (3, 2.5), 0.5, 0.5), ((0, 0), (0, 0.0), None, 0.0)]
)
def test_scan_is_held_against_the_layer_that_it_shows(
    layers: tuple[int, ...], last: tuple[int, float], growth: float | None, surface: float
) -> None:
    """Growth of a scan that jumps is that of all layers between; an older layer has its own surface."""
    job = toy_job()
    ones = np.ones((job.nx, job.ny))
    shadow, _ = begun(job, scan(-1, 0 * ones, False))
    for command, layer in enumerate(layers):
        shadow.do_step(command * SECOND, SECOND, inputs(job, command, command, 1, scan(layer, 0 * ones)))
    command, (layer, height) = len(layers) - 1, last
    outputs = shadow.do_step(9 * SECOND, SECOND, inputs(job, command, command, 1, scan(layer, height * DROPLET * ones)))
    assert int(outputs["layers_compared"]) == layer
    assert float(outputs["surface_divergence"]) == pytest.approx(surface * DROPLET, rel=1e-9, abs=1e-18)
    if growth is not None:
        assert float(outputs["growth_divergence"]) == pytest.approx(growth * DROPLET, rel=1e-9, abs=0.0)


def test_shadow_may_begin_after_layers_of_an_earlier_part_of_the_print() -> None:
    job = toy_job()
    shadow = Shadow(job, StartingPrinter)
    assert int(shadow.initialize(0, inputs(job, 3, 3, 0))["layers_followed"]) == 3
    values = shadow.do_step(0, SECOND, inputs(job, 4, 4, 1))
    assert (int(values["layers_followed"]), values["height"].max()) == (4, DROPLET)


class Watched(StartingPrinter):
    """Knows whether it was terminated."""

    is_over = False

    def terminate(self) -> None:
        self.is_over = True


def test_plant_that_begins_again_on_a_scan_ends_the_one_before() -> None:
    job, made = toy_job(), list[Watched]()

    def make(wanted: Job) -> Component:
        made.append(Watched(wanted))
        return made[-1]

    shadow = Shadow(job, make)
    shadow.initialize(0, inputs(job, 0, 0, 0))
    shadow.do_step(0, SECOND, inputs(job, 0, 0, 0, scan(0, np.full((4, 3), 7e-6))))
    assert [plant.is_over for plant in made] == [True, False]
    shadow.terminate()
    assert made[-1].is_over


def test_model_of_a_file_begins_on_the_scan() -> None:
    job = small_job(4, 3)
    shadow = catalog.make("Shadow", job, {"variation": 0.0})
    shadow.initialize(0, inputs(job, 0, 0, 0))
    plate = np.linspace(0.0, 9e-6, 12).reshape(4, 3)
    outputs = shadow.do_step(0, SECOND, inputs(job, 0, 0, 0, scan(0, plate)))
    np.testing.assert_allclose(outputs["height"], plate, rtol=0.0, atol=1e-12)
    shadow.terminate()


def test_pattern_of_a_command_stays_as_it_was_commanded() -> None:
    """Whatever becomes of the array."""
    job = toy_job()
    shadow, _ = begun(job)
    given = inputs(job, 1, 0, 1)
    shadow.do_step(0, SECOND, given)
    given["pattern"][:] = 0
    assert shadow.do_step(SECOND, SECOND, inputs(job, 1, 1, 0))["height"].max() == DROPLET


def surfaces(shadow: Shadow) -> list[str]:
    """Of the saved state."""
    return sorted(key for key in np.load(io.BytesIO(shadow.save())).files if key.startswith("surface/"))


def test_surfaces_are_kept_from_the_last_scan_on() -> None:
    job = toy_job()
    flat = np.zeros((4, 3))
    shadow, _ = begun(job, scan(-1, flat, False))
    for command, layer in enumerate((0, 0, 0, 2, 2)):
        shadow.do_step(command * SECOND, SECOND, inputs(job, command, command, 1, scan(layer, flat)))
    assert surfaces(shadow) == ["surface/2", "surface/3", "surface/4"]
    blind, _ = begun(job)
    for command in (1, 2, 3):
        blind.do_step(command * SECOND, SECOND, inputs(job, command, command, 1))
    assert surfaces(blind) == ["surface/3"]


def test_layer_given_up_stays_so_where_its_scan_comes_later() -> None:
    """After the next layer, whose surface is that of the model; also in a state that was saved in between."""
    job = toy_job()
    flat = np.zeros((4, 3))
    first, other = (begun(job, scan(-1, flat, False))[0] for _ in "ab")
    first.do_step(0, SECOND, inputs(job, 0, 0, 0, scan(0, flat)))
    unknown = {"layer_unknown": np.asarray(True)}
    first.do_step(SECOND, SECOND, {**inputs(job, 1, 1, 1, scan(0, flat)), **unknown})
    first.do_step(2 * SECOND, SECOND, inputs(job, 2, 1, 1, scan(0, flat)))  # a pattern not deposited yet
    other.initialize(0, inputs(job, 0, 0, 0, scan(-1, flat, False)))
    other.restore(first.save())
    for shadow in (first, other):
        outputs = shadow.do_step(3 * SECOND, SECOND, inputs(job, 2, 2, 0, scan(0, flat)))
        assert outputs["height"].max() == 2 * DROPLET
        outputs = shadow.do_step(4 * SECOND, SECOND, inputs(job, 2, 2, 0, scan(1, flat)))
        assert (int(outputs["layers_compared"]), int(outputs["status"])) == (1, Status.UNTRUSTED)
        assert np.isnan(float(outputs["growth_divergence"]))
        assert outputs["height"].max() == 2 * DROPLET


def test_last_comparison_is_that_of_the_saved_state() -> None:
    job = toy_job()
    flat = np.zeros((4, 3))
    first, other = (begun(job, scan(-1, flat, False))[0] for _ in "ab")
    first.do_step(0, SECOND, inputs(job, 0, 0, 0, scan(0, flat)))
    last = inputs(job, 1, 1, 1, scan(1, flat + 0.5 * DROPLET))
    first.do_step(SECOND, SECOND, last)
    other.restore(first.save())
    for shadow in (first, other):
        outputs = shadow.do_step(2 * SECOND, SECOND, last)
        assert int(outputs["layers_compared"]) == 1
        for name in ("growth_divergence", "surface_divergence"):
            assert float(outputs[name]) == pytest.approx(0.5 * DROPLET, rel=1e-9, abs=0.0)


def test_start_surface_is_the_scan_and_elsewhere_what_was_assumed_moved_by_the_median() -> None:
    assumed = np.array([[0.0, 1.0, 2.0, 3.0]])
    measured, seen = np.array([[10.0, 12.0, 99.0, 0.0]]), np.array([[True, True, True, False]])
    np.testing.assert_array_equal(start_surface(assumed, measured, seen), [[10.0, 12.0, 99.0, 14.0]])
    assert start_surface(assumed, measured, ~(seen | True)) is assumed


def test_what_cannot_be_followed_is_refused() -> None:
    job = toy_job()
    for command, printed, message in ((2, 0, "2 after 0: a pattern was missed"), (0, 1, "layer 1 was never commanded")):
        with pytest.raises(ComponentError, match=message):
            begun(job)[0].do_step(0, SECOND, inputs(job, command, printed, 1))
    back, _ = begun(job)
    back.do_step(0, SECOND, inputs(job, 1, 1, 1))
    with pytest.raises(ComponentError, match="0 after 1: a pattern was missed"):
        back.do_step(SECOND, SECOND, inputs(job, 0, 1, 1))
    with pytest.raises(ComponentError, match="no state of a shadow"):
        begun(job)[0].restore(b"something else")
    job = small_job()
    shadow = catalog.make("Shadow", job, {"layer_duration_s": 5.0})
    shadow.initialize(0, inputs(job, 0, 0, 0))
    with pytest.raises(ComponentError, match="has not completed layer 1 in one step of 1 s; leave its duration out"):
        shadow.do_step(0, SECOND, inputs(job, 1, 1, 1))
    shadow.terminate()


@pytest.mark.parametrize(
    ("options", "expected", "on_scan"),
    [({}, (3e-6, np.inf), True), ({"start": "job", "alarm_um": 4.0, "stop_um": 9.0}, (4e-6, 9e-6), False)],
)
def test_options_of_a_file_reach_the_shadow_in_metres(
    options: dict[str, Any], expected: tuple[float, float], on_scan: bool
) -> None:
    job = replace(small_job(4, 3), height_start=np.full((4, 3), 1e-6))
    checked = catalog.check("Shadow", job, {**options, "h1_a_um": 4.2})
    assert checked.ports is not None
    shadow: Any = checked.make(Bench())
    assert (checked.ports.starts_on_scan, shadow.starts_on_scan) == (on_scan, on_scan)
    assert (shadow._alarm, shadow._stop) == pytest.approx(expected, rel=1e-12, abs=0.0)
    values = shadow.initialize(0, {port.name: port.start_value() for port in shadow.inputs})
    np.testing.assert_allclose(values["height"], 1e-6, rtol=1e-12)
    shadow.terminate()

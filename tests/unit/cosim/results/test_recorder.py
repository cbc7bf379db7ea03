from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inkloop.component import Port, Values
from inkloop.course.layer_course import LayerCourse
from inkloop.course.wiring import contract_connections
from inkloop.master.master import Master
from inkloop.results.metrics import masked_error
from inkloop.results.recorder import COUNTER_END, LayerRow, Recorder
from support.toys import DROPLET, FunctionComponent, ToyPrinter, toy_job, toy_loop

SECOND = 1_000_000_000


def printed_loop(layers: int = 4) -> tuple[Recorder, list[LayerRow]]:
    job = toy_job(layers=layers)
    parts = toy_loop(job, 2 * SECOND, 6 * SECOND)
    rows: list[LayerRow] = []
    recorder = Recorder(job, parts, rows.append)
    Master(
        parts,
        contract_connections(parts),
        step_ns=SECOND,
        observers=[recorder],
        course=LayerCourse(parts, layers_max=100),
    ).run()
    return recorder, rows


def test_row_of_a_layer_holds_what_belongs_to_that_layer() -> None:
    recorder, _ = printed_loop(layers=4)
    run = recorder.dataset()
    mask = run.mask.values
    for layer in range(5):
        np.testing.assert_array_equal(run.height[layer], np.where(mask, layer * DROPLET, 0.0))
        np.testing.assert_array_equal(run.measured_height[layer], run.height[layer])
        np.testing.assert_array_equal(run.pattern[layer], mask if layer else np.zeros_like(mask))
        assert run.droplets_a[layer] == layer * mask.sum()
    np.testing.assert_array_equal(run.objective[1:], mask.sum())
    assert np.isnan(run.objective[0])
    assert np.all(np.diff(run.time) > 0)


def test_errors_by_layer_are_target_minus_height_over_the_part() -> None:
    recorder, _ = printed_loop(layers=4)
    run = recorder.dataset()
    np.testing.assert_allclose(run.mean_error, DROPLET * np.arange(4, -1, -1), atol=1e-18)
    np.testing.assert_allclose(run.mae, run.mean_error, atol=1e-18)
    np.testing.assert_allclose(run["std"], 0.0, atol=1e-18)


def test_error_figures_of_a_known_surface() -> None:
    target = np.array([[4.0, 4.0, 9.0]])
    error = masked_error(np.array([[1.0, 5.0, 0.0]]), target, np.array([[True, True, False]]))
    assert (error.mean_error, error.mae, error.rms, error.std) == (
        1.0,
        2.0,
        pytest.approx(5**0.5, rel=1e-9, abs=0.0),
        2.0,
    )
    assert (error.min, error.max) == (-1.0, 3.0)


def test_every_layer_is_reported_once_in_order() -> None:
    recorder, rows = printed_loop(layers=4)
    assert [row.layer for row in rows] == [0, 1, 2, 3, 4]
    assert [row.mean_error for row in rows] == pytest.approx(recorder.dataset().mean_error.values, rel=1e-9, abs=0.0)
    assert rows[-1].scalars["objective"] == toy_job().mask.sum()


def test_every_array_has_a_unit_and_a_meaning() -> None:
    run = printed_loop()[0].dataset()
    assert {name for name, array in run.variables.items() if not {"units", "long_name"} <= set(array.attrs)} == set()
    assert (run.height.attrs["units"], run.time.attrs["units"], run.x.attrs["units"]) == ("m", "s", "m")


def test_layers_that_were_jumped_over_are_empty() -> None:
    job = toy_job(layers=6)
    height = np.ones((job.nx, job.ny))
    numbers = iter([2, 2, 5])

    def jump(time_ns: int, step_ns: int, inputs: Values) -> Values:
        number = next(numbers)
        return {"height": number * height, "layers_printed": np.asarray(number)}

    printer = FunctionComponent(outputs=[Port("height", "m", (job.nx, job.ny)), Port("layers_printed")], step=jump)
    recorder = Recorder(job, {"printer": printer})
    Master({"printer": printer}, [], step_ns=1, observers=[recorder]).run(time_max_ns=3)
    run = recorder.dataset()
    assert np.isfinite(run.height).all(("x", "y")).values.tolist() == [True, False, True, False, False, True]
    np.testing.assert_array_equal(run.height[5], 5 * height)
    assert np.isfinite(run.mean_error).values.tolist() == [True, False, True, False, False, True]


def test_component_may_write_each_layer_into_the_same_array() -> None:
    job = toy_job(layers=6)
    height, count = np.zeros((job.nx, job.ny)), np.zeros((), np.int32)

    def grow(time_ns: int, step_ns: int, inputs: Values) -> Values:
        height[...] += DROPLET
        count[...] += 1
        return {"height": height, "layers_printed": count}

    ports = [Port("height", "m", (job.nx, job.ny)), Port("layers_printed", dtype="int32")]
    printer = FunctionComponent(outputs=ports, step=grow)
    recorder = Recorder(job, {"printer": printer})
    Master({"printer": printer}, [], step_ns=1, observers=[recorder]).run(time_max_ns=3)
    np.testing.assert_allclose(recorder.dataset().height[1:, 0, 0], DROPLET * np.arange(1, 4), rtol=1e-12)


@pytest.mark.parametrize(
    ("scans", "found"),
    [
        ((0, 0, 2, 2), (0, 0, 2, 2)),
        ((0, 1, 1, 3), (0, 1, 1, 3)),
        ((-1, 1, 1, 3), (np.nan, 1, 1, 3)),
        ((-1, -1, 2, 2), (np.nan, np.nan, 2, 2)),
    ],
    ids=["layer 1 is not scanned", "layer 2 is not scanned", "the start surface is not scanned", "both are not"],
)
def test_layer_that_was_not_scanned_has_the_surface_of_the_scan_before_it(
    scans: tuple[int, ...], found: tuple[float, ...]
) -> None:
    """A printer that does not know its surface, and a real profiler: what it saw at each printed layer."""
    job = toy_job()
    shape = (job.nx, job.ny)
    printed, scanned = iter(range(1, len(scans))), iter(scans)

    def scan(*_: object) -> Values:
        number = next(scanned)
        return {"measured_height": np.full(shape, float(number)), "layers_scanned": np.asarray(number)}

    printer = FunctionComponent(
        outputs=[Port("layers_printed")], step=lambda *_: {"layers_printed": np.asarray(next(printed))}
    )
    profiler = FunctionComponent(
        outputs=[Port("measured_height", "m", shape), Port("layers_scanned")], step=scan, start=scan
    )
    profiler.is_device = True  # type: ignore[attr-defined]
    parts = {"printer": printer, "profiler": profiler}
    recorder = Recorder(job, parts)
    Master(parts, [], step_ns=1, observers=[recorder]).run(time_max_ns=len(scans) - 1)
    run = recorder.dataset()
    np.testing.assert_array_equal(run.height, np.broadcast_to(np.reshape(found, (-1, 1, 1)), (len(scans), *shape)))
    expected = [float((job.target_height - one)[job.mask].mean()) for one in found]
    np.testing.assert_allclose(run.mean_error, expected, rtol=1e-12)


def test_printer_alone_is_recorded() -> None:
    job = toy_job()
    printer: Any = ToyPrinter(job)
    printer.inputs = ()
    recorder = Recorder(job, {"printer": printer})
    values = {"pattern": job.mask.astype(np.int32), "layer_command": np.asarray(1)}
    recorder.initialized(0, {"printer": printer.initialize(0, {})})
    recorder.stepped(SECOND, {"printer": printer.do_step(0, SECOND, values)})
    run = recorder.dataset()
    assert run.height.shape == (2, job.nx, job.ny)
    assert "measured_height" not in run
    assert run.time.values.tolist() == [0.0, 1.0]


def test_same_name_from_two_components_is_kept_apart() -> None:
    job = toy_job()
    temperature = Port("temperature", "K", start=1.0)
    parts: dict[str, Any] = dict(toy_loop(job))
    for start, name in ((300.0, "printer"), (310.0, "profiler")):
        parts[name].outputs += (Port("temperature", "K", start=start),)
        step, first = parts[name].do_step, parts[name].initialize
        extra = {"temperature": np.asarray(start)}
        parts[name].do_step = lambda t, h, i, step=step, extra=extra: {**step(t, h, i), **extra}
        parts[name].initialize = lambda t, i, first=first, extra=extra: {**first(t, i), **extra}
    recorder = Recorder(job, parts)
    Master(
        parts, contract_connections(parts), step_ns=1, observers=[recorder], course=LayerCourse(parts, layers_max=2)
    ).run()
    run = recorder.dataset()
    assert (float(run.temperature[-1]), float(run.profiler_temperature[-1])) == (300.0, 310.0)
    assert run.profiler_temperature.attrs["units"] == temperature.unit


def test_droplets_are_counted_on_where_the_counter_of_the_printer_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    """The counter of a printer has 32 bits, and stays at its end."""
    whole = printed_loop(layers=6)[0].dataset().droplets_a.values
    monkeypatch.setattr("inkloop.results.recorder.COUNTER_END", int(whole[2]) + 1)
    keep = Recorder._keep

    def saturated(self: Recorder, role: str, name: str, layer: int, values: Values) -> None:
        if name == "droplets_a":
            values = {name: np.minimum(values[name], int(whole[2]) + 1).astype(np.int32)}
        keep(self, role, name, layer, values)

    monkeypatch.setattr(Recorder, "_keep", saturated)
    found = printed_loop(layers=6)[0].dataset().droplets_a
    np.testing.assert_array_equal(found, whole)
    assert found.dtype == np.int64


def test_droplets_beyond_the_end_of_a_counter_are_those_of_their_ink() -> None:
    job = toy_job()
    shape = (job.nx, job.ny)
    controller = FunctionComponent(outputs=[Port("layer_command"), Port("pattern", "1", shape, "int32")])
    printer = FunctionComponent(outputs=[Port("layers_printed"), Port("droplets_a"), Port("droplets_b")])
    recorder = Recorder(job, {"controller": controller, "printer": printer})
    pattern = np.zeros(shape, np.int32)
    pattern.flat[:3], pattern.flat[3:8] = 1, 2
    for layer, count in enumerate((COUNTER_END - 1, COUNTER_END)):
        counted = np.asarray(count, np.int32)
        values: dict[str, Values] = {
            "controller": {"layer_command": np.asarray(layer), "pattern": pattern},
            "printer": {"layers_printed": np.asarray(layer), "droplets_a": counted, "droplets_b": counted},
        }
        (recorder.stepped if layer else recorder.initialized)(layer * SECOND, values)
    run = recorder.dataset()
    assert (int(run.droplets_a[1]), int(run.droplets_b[1])) == (COUNTER_END + 2, COUNTER_END + 4)


def test_resumed_run_keeps_the_rows_it_has() -> None:
    """The layer that it resumes at was printed earlier, and is neither recorded nor reported again."""
    job = toy_job()
    height = Port("height", "m", (job.nx, job.ny))
    parts = {"printer": FunctionComponent(outputs=[height, Port("layers_printed")])}
    first = Recorder(job, parts)
    values: dict[str, Values] = {"printer": {"height": np.ones(height.shape), "layers_printed": np.asarray(2)}}
    first.initialized(SECOND, values)
    reported: list[LayerRow] = []
    resumed = Recorder(job, parts, reported.append)
    resumed.put_rows(first.take_rows())
    resumed.initialized(9 * SECOND, values)
    assert (resumed.take_rows(), reported) == ({}, [])
    assert float(resumed.table().time[2]) == 1.0

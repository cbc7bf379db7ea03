"""Values that a recorder keeps of each component, and their layers, in a print and step by step by hand."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Port, Status, Values
from inkloop.course.layer_course import LayerCourse, contract_connections
from inkloop.master.master import Master
from inkloop.results.metrics import masked_error
from inkloop.results.recorder import COUNTER_END, LayerRow, Recorder
from support.toys import DROPLET, FunctionComponent, toy_job, toy_loop

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
    recorder, rows = printed_loop(layers=4)
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
    np.testing.assert_allclose(run.mean_error, DROPLET * np.arange(4, -1, -1), atol=1e-18)
    np.testing.assert_allclose(run.mae, run.mean_error, atol=1e-18)
    np.testing.assert_allclose(run["std"], 0.0, atol=1e-18)
    assert [row.layer for row in rows] == [0, 1, 2, 3, 4]  # each is reported once, in order
    assert [row.mean_error for row in rows] == pytest.approx(run.mean_error.values, rel=1e-9, abs=0.0)
    assert rows[-1].scalars["objective"] == mask.sum()
    assert {name for name, array in run.variables.items() if not {"units", "long_name"} <= set(array.attrs)} == set()
    assert (run.height.attrs["units"], run.time.attrs["units"], run.x.attrs["units"]) == ("m", "s", "m")


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


@pytest.mark.parametrize(("levels", "of_a", "of_b"), [((), 3, 5), ((1, 2, 4, 1, 1, 1, 1, 3), 7, 7)])
def test_droplets_beyond_the_end_of_a_counter_are_those_of_their_ink(
    levels: tuple[int, ...], of_a: int, of_b: int
) -> None:
    job = toy_job()
    shape = (job.nx, job.ny)
    controller = FunctionComponent(outputs=[Port("layer_command"), Port("pattern", "1", shape, "int32")])
    own: dict[str, Any] = {}
    if levels:
        controller.outputs += (Port("drop_level", "1", shape, "int32"),)
        own["drop_level"] = np.ones(shape, np.int32)
        own["drop_level"].flat[: len(levels)] = levels
    printer = FunctionComponent(outputs=[Port("layers_printed"), Port("droplets_a"), Port("droplets_b")])
    recorder = Recorder(job, {"controller": controller, "printer": printer})
    pattern = np.zeros(shape, np.int32)
    pattern.flat[:3], pattern.flat[3:8] = 1, 2
    for layer, count in enumerate((COUNTER_END - 1, COUNTER_END, COUNTER_END)):
        counted = np.asarray(count, np.int32)
        values: dict[str, Values] = {
            "controller": {"layer_command": np.asarray(layer), "pattern": pattern, **own},
            "printer": {"layers_printed": np.asarray(layer), "droplets_a": counted, "droplets_b": counted},
        }
        (recorder.stepped if layer else recorder.initialized)(layer * SECOND, values)
    run = recorder.dataset()
    assert run.droplets_a.values.tolist() == [COUNTER_END - 1 + layer * of_a for layer in range(3)]
    assert run.droplets_b.values.tolist() == [COUNTER_END - 1 + layer * of_b for layer in range(3)]


JOB = toy_job()
SHAPE = (JOB.nx, JOB.ny)
HEIGHT, MEASURED = Port("height", "m", SHAPE), Port("measured_height", "m", SHAPE)


def outputs_of(*outputs: Port, is_device: bool = False) -> Any:
    return SimpleNamespace(inputs=(), outputs=outputs, is_device=is_device)


def number(name: str) -> Port:
    return Port(name, dtype="int32")


def flat(um: float) -> np.ndarray[Any, Any]:
    return np.full(SHAPE, um * 1e-6)


def mean_um(um: float) -> float:
    """Mean error of a flat surface [um]."""
    return JOB.target_height.max() * 1e6 - um


CONTROLLER = (
    number("layer_command"), number("status"), Port("pattern", "1", SHAPE, "int32"), number("stage"),
    Port("drop_level", "1", SHAPE, "int32"), Port("estimated_height", "m", SHAPE), Port("objective", "m"),
)  # fmt: skip


def commanded(layer: int, status: Status = Status.IDLE) -> Values:
    pattern, level = np.full(SHAPE, layer, np.int32), np.full(SHAPE, 1 + layer, np.int32)
    scalars = {"layer_command": layer, "status": int(status), "stage": 10 + layer, "objective": 0.5 * layer}
    maps = {"pattern": pattern, "drop_level": level, "estimated_height": flat(100.0 * layer + status)}
    return {**{name: np.asarray(value) for name, value in scalars.items()}, **maps}


def test_plan_belongs_to_the_layer_that_it_commands_and_its_estimate_to_the_one_before() -> None:
    recorder = Recorder(
        JOB, {"planner": outputs_of(*CONTROLLER), "printer": outputs_of(HEIGHT, number("layers_printed"))}
    )

    def step(command: int, printed: int, status: Status = Status.IDLE) -> Mapping[str, Values]:
        printer: Values = {"height": flat(10.0 * printed), "layers_printed": np.asarray(printed)}
        return {"planner": commanded(command, status), "printer": printer}

    recorder.initialized(0, step(0, 0))
    for point, values in enumerate((step(1, 0), step(1, 1), step(2, 1), step(2, 2), step(2, 2, Status.DONE)), 1):
        recorder.stepped(point * SECOND, values)
    run = recorder.dataset()
    assert recorder.layers == 2
    assert recorder.scanned == -1
    np.testing.assert_array_equal(run.pattern[:, 1, 1], [0, 1, 2])
    np.testing.assert_array_equal(run.drop_level[:, 1, 1], [0, 2, 3])
    np.testing.assert_array_equal(run.objective, [np.nan, 0.5, 1.0])
    np.testing.assert_array_equal(run.stage, [0, 11, 12])
    assert run.stage.dtype.kind == "i"
    np.testing.assert_allclose(run.estimated_height[:, 1, 1] * 1e6, [100.0, 200.0, 200.0 + Status.DONE], rtol=1e-12)
    np.testing.assert_array_equal(run.time, [0.0, 2.0, 4.0])  # when it was printed, not commanded
    assert "status" not in run
    assert (run.objective.attrs["units"], run.pattern.attrs["units"]) == ("m", "1")
    np.testing.assert_array_equal(run.target_height, JOB.target_height)
    np.testing.assert_array_equal(run["mask"], JOB.mask)
    np.testing.assert_allclose(run.x, np.arange(JOB.nx) * JOB.pitch, rtol=1e-12)
    np.testing.assert_allclose(run.y, np.arange(JOB.ny) * JOB.pitch, rtol=1e-12)
    assert run.layer.values.tolist() == [0, 1, 2]
    assert run.attrs["pitch"] == JOB.pitch
    recorder.stepped(6 * SECOND, step(3, 2))  # commanded, and never printed
    np.testing.assert_array_equal(recorder.table().stage, [0, 11, 12])


@pytest.mark.parametrize("reason", [1, 2])
def test_stop_stands_in_the_row_of_the_layer_whose_scan_it_was(reason: int) -> None:
    planner = outputs_of(*CONTROLLER, number("stop_reason"), number("stop_layer"), Port("stop_figure"))
    recorder = Recorder(JOB, {"planner": planner, "printer": outputs_of(HEIGHT, number("layers_printed"))})

    def step(command: int, printed_: int, stop: int) -> Mapping[str, Values]:
        ended = {"stop_reason": stop, "stop_layer": 3 * stop, "stop_figure": 0.25 * stop}
        values = {name: np.asarray(value) for name, value in ended.items()}
        printer: Values = {"height": flat(10.0 * printed_), **printed(printed_)}
        return {"planner": {**commanded(command), **values}, "printer": printer}

    recorder.initialized(0, step(0, 0, 0))
    for point, values in enumerate((step(1, 0, 0), step(1, 1, 0), step(2, 1, 0), step(2, 2, reason)), 1):
        recorder.stepped(point * SECOND, values)
    run = recorder.dataset()
    assert run.stop_reason.values.tolist() == [0, 0, reason]
    assert run.stop_layer.values.tolist() == [0, 0, 3 * reason]
    np.testing.assert_allclose(run.stop_figure, [np.nan, 0.0, 0.25 * reason], rtol=1e-12)
    np.testing.assert_allclose(run.estimated_height[:, 1, 1] * 1e6, [100.0, 200.0, 200.0], rtol=1e-12)


def test_scan_and_its_valid_cells_belong_to_the_layer_of_the_scan() -> None:
    profiler = outputs_of(MEASURED, Port("valid", "1", SHAPE, "bool"), number("layers_scanned"), Port("shift", "m"))
    recorder = Recorder(JOB, {"printer": outputs_of(HEIGHT, number("layers_printed")), "profiler": profiler})

    def step(printed: int, scanned: int) -> Mapping[str, Values]:
        valid = np.ones(SHAPE, np.bool_)
        valid[0, max(scanned, 0)] = False
        scan: Values = {"measured_height": flat(scanned), "valid": valid, "shift": np.asarray(1e-6 * scanned)}
        printer: Values = {"height": flat(10.0 * printed), "layers_printed": np.asarray(printed)}
        return {"printer": printer, "profiler": {**scan, "layers_scanned": np.asarray(scanned)}}

    recorder.initialized(0, step(0, 0))
    for point, values in enumerate((step(1, 0), step(2, 0), step(2, 2)), 1):
        recorder.stepped(point * SECOND, values)
    assert recorder.scanned == 2
    run = recorder.dataset()
    np.testing.assert_allclose(run.measured_height[:, 1, 1] * 1e6, [0.0, np.nan, 2.0], rtol=1e-12)
    assert [np.argwhere(~run.valid.values[layer]).tolist() for layer in (0, 2)] == [[[0, 0]], [[0, 2]]]
    np.testing.assert_allclose(run["shift"] * 1e6, [0.0, np.nan, 2.0], rtol=1e-12)
    np.testing.assert_allclose(run.mean_error * 1e6, [mean_um(0), mean_um(10), mean_um(20)], rtol=1e-12)  # of `height`


def test_scan_before_the_first_is_none() -> None:
    rows: list[LayerRow] = []
    recorder = Recorder(JOB, {"profiler": outputs_of(MEASURED, number("layers_scanned"))}, rows.append)
    recorder.initialized(0, {"profiler": {"measured_height": flat(3.0), "layers_scanned": np.asarray(-1)}})
    assert (recorder.take_rows(), rows) == ({}, [])
    recorder.stepped(SECOND, {"profiler": {"measured_height": flat(4.0), "layers_scanned": np.asarray(0)}})
    assert [(row.layer, row.time, row.mean_error * 1e6) for row in rows] == [
        (0, 1.0, pytest.approx(mean_um(4.0), rel=1e-9, abs=0.0))
    ]
    assert recorder.layers == 0
    np.testing.assert_allclose(recorder.dataset().measured_height[:, 1, 1] * 1e6, [4.0], rtol=1e-12)


def test_of_two_profilers_the_first_one_is_recorded() -> None:
    names = ("profiler", "second")
    recorder = Recorder(JOB, {name: outputs_of(MEASURED, number("layers_scanned")) for name in names})
    heights = zip(names, (3.0, 4.0), strict=True)
    recorder.initialized(
        0, {name: {"measured_height": flat(um), "layers_scanned": np.asarray(0)} for name, um in heights}
    )
    np.testing.assert_allclose(recorder.dataset().measured_height[:, 1, 1] * 1e6, [3.0], rtol=1e-12)


SHADOW = outputs_of(
    HEIGHT, number("layers_followed"), number("layers_compared"), number("status"), Port("growth_divergence", "m")
)


def followed(layer: int, compared: int, um: float, status: int = 0) -> Values:
    scalars = {"layers_followed": layer, "layers_compared": compared, "status": status, "growth_divergence": um * 1e-6}
    return {"height": flat(um), **{name: np.asarray(value) for name, value in scalars.items()}}


def printed(layer: int) -> Values:
    return {"layers_printed": np.asarray(layer)}


def test_print_without_a_known_surface_is_judged_by_its_shadow() -> None:
    rows: list[LayerRow] = []
    recorder = Recorder(JOB, {"printer": outputs_of(number("layers_printed")), "shadow": SHADOW}, rows.append)
    recorder.initialized(0, {"printer": printed(0), "shadow": followed(0, -1, 1.0)})
    for point, step in enumerate(
        [
            {"printer": printed(0), "shadow": followed(0, 0, 2.0, 0)},  # the scan of layer 0 moves its surface
            {"printer": printed(1), "shadow": followed(1, 0, 11.0)},
            {"printer": printed(1), "shadow": followed(1, 1, 12.0, 4)},  # as above, of layer 1
            {"printer": printed(2), "shadow": followed(2, 1, 21.0)},
            {"printer": printed(3), "shadow": followed(3, 2, 31.0)},  # layer 2 was compared on top of layer 3
        ],
        1,
    ):
        recorder.stepped(point * SECOND, step)
    run = recorder.dataset()
    np.testing.assert_allclose(run.shadow_height[:, 1, 1] * 1e6, [2.0, 12.0, 21.0, 31.0], rtol=1e-12)
    np.testing.assert_array_equal(run.height, run.shadow_height)
    assert run.height.attrs["source"] == "shadow_height"
    np.testing.assert_array_equal(run.shadow_status, [0, 4, 0, 0])
    np.testing.assert_allclose(run.growth_divergence * 1e6, [2.0, 12.0, 31.0, np.nan], rtol=1e-12)
    assert [row.layer for row in rows] == [0, 1, 2, 3]
    assert [row.mean_error * 1e6 for row in rows] == pytest.approx(
        [mean_um(1), mean_um(11), mean_um(21), mean_um(31)], rel=1e-9, abs=0.0
    )
    assert [row.time for row in rows] == [0.0, 2.0, 4.0, 5.0]


@pytest.mark.parametrize(
    ("has_height", "is_device", "expected"),
    [(True, True, 1.0), (False, True, 3.0), (False, False, 2.0)],
    ids=["printer", "real profiler", "shadow before a modelled profiler"],
)
def test_surface_is_that_of_who_knows_best(has_height: bool, is_device: bool, expected: float) -> None:
    parts = {
        "printer": outputs_of(*([HEIGHT] if has_height else []), number("layers_printed")),
        "shadow": SHADOW,
        "profiler": outputs_of(MEASURED, number("layers_scanned"), is_device=is_device),
    }
    rows: list[LayerRow] = []
    recorder = Recorder(JOB, parts, rows.append)
    recorder.initialized(
        0,
        {
            "printer": {"height": flat(1.0), **printed(0)},
            "shadow": followed(0, 0, 2.0),
            "profiler": {"measured_height": flat(3.0), "layers_scanned": np.asarray(0)},
        },
    )
    run = recorder.dataset()
    np.testing.assert_allclose(run.height[0] * 1e6, expected, rtol=1e-12)
    assert [row.mean_error * 1e6 for row in rows] == pytest.approx([mean_um(expected)], rel=1e-9, abs=0.0)


def test_row_that_is_reported_has_all_figures_of_the_layer() -> None:
    rows: list[LayerRow] = []
    printer = outputs_of(HEIGHT, number("layers_printed"), number("droplets_a"), Port("volume_lost", "m3"))
    recorder = Recorder(JOB, {"printer": printer}, rows.append)
    height = JOB.target_height - 2e-6 * JOB.mask
    height[1, 0] += 4e-6
    values = {"layers_printed": 3, "droplets_a": 17, "volume_lost": 4e-15}
    arrays = {name: np.asarray(value) for name, value in values.items()}
    recorder.initialized(5 * SECOND, {"printer": {"height": height, **arrays}})
    (row,) = rows
    cells = int(JOB.mask.sum())
    errors = np.array([-2.0] + [2.0] * (cells - 1))
    assert (row.layer, row.time) == (3, 5.0)
    found = np.array([row.mean_error, row.mae, row.std]) * 1e6
    np.testing.assert_allclose(found, [errors.mean(), 2.0, errors.std()], rtol=1e-9)
    assert row.scalars == {"droplets_a": 17.0, "volume_lost": 4e-15}
    run = recorder.table()
    np.testing.assert_allclose(run.rms[3] * 1e6, 2.0, rtol=1e-9)
    assert np.isnan(run.rms[:3]).all()
    np.testing.assert_allclose(run["std"][3] * 1e6, errors.std(), rtol=1e-9)


def test_rows_that_were_handed_over_are_put_back_as_they_were() -> None:
    def steps(recorder: Recorder, first: int, last: int) -> None:
        for layer in range(first, last):
            values = {"printer": {"height": flat(10.0 * layer), "droplets_a": np.asarray(layer * 5), **printed(layer)}}
            (recorder.stepped if layer else recorder.initialized)(layer * SECOND, values)

    parts = {"printer": outputs_of(HEIGHT, number("layers_printed"), number("droplets_a"))}
    reported: list[LayerRow] = []
    whole, begun, resumed = Recorder(JOB, parts), Recorder(JOB, parts), Recorder(JOB, parts, reported.append)
    steps(whole, 0, 4)
    steps(begun, 0, 3)
    rows = begun.take_rows()
    assert begun.take_rows() == {}
    resumed.put_rows(rows)
    last: Values = {"height": flat(20.0), "droplets_a": np.asarray(10), **printed(2)}
    resumed.initialized(9 * SECOND, {"printer": last})
    assert (resumed.layers, resumed.take_rows(), reported) == (2, {}, [])  # layer 2 is not recorded again
    steps(resumed, 3, 4)
    both = resumed.maps([rows]).added_to(resumed.table())
    assert both.identical(whole.dataset())
    assert both.dtypes == whole.dataset().dtypes
    np.testing.assert_allclose(both.height[:, 1, 1], [0.0, DROPLET, 2 * DROPLET, 3 * DROPLET], rtol=1e-9)

"""Values that a recorder keeps of each component, and their layers, step by step with values made up by hand."""

from __future__ import annotations

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Port, Status, Values
from inkloop.results.recorder import LayerRow, Recorder
from support.toys import DROPLET, toy_job

SECOND = 1_000_000_000
JOB = toy_job()
SHAPE = (JOB.nx, JOB.ny)
HEIGHT, MEASURED = Port("height", "m", SHAPE), Port("measured_height", "m", SHAPE)


def part(*outputs: Port, is_device: bool = False) -> Any:
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
    recorder = Recorder(JOB, {"planner": part(*CONTROLLER), "printer": part(HEIGHT, number("layers_printed"))})

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


def test_scan_and_its_valid_cells_belong_to_the_layer_of_the_scan() -> None:
    profiler = part(MEASURED, Port("valid", "1", SHAPE, "bool"), number("layers_scanned"), Port("shift", "m"))
    recorder = Recorder(JOB, {"printer": part(HEIGHT, number("layers_printed")), "profiler": profiler})

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
    recorder = Recorder(JOB, {"profiler": part(MEASURED, number("layers_scanned"))}, rows.append)
    recorder.initialized(0, {"profiler": {"measured_height": flat(3.0), "layers_scanned": np.asarray(-1)}})
    assert (recorder.take_rows(), rows) == ({}, [])
    recorder.stepped(SECOND, {"profiler": {"measured_height": flat(4.0), "layers_scanned": np.asarray(0)}})
    assert [(row.layer, row.time, row.mean_error * 1e6) for row in rows] == [
        (0, 1.0, pytest.approx(mean_um(4.0), rel=1e-9, abs=0.0))
    ]


SHADOW = part(
    HEIGHT, number("layers_followed"), number("layers_compared"), number("status"), Port("growth_divergence", "m")
)


def followed(layer: int, compared: int, um: float, status: int = 0) -> Values:
    scalars = {"layers_followed": layer, "layers_compared": compared, "status": status, "growth_divergence": um * 1e-6}
    return {"height": flat(um), **{name: np.asarray(value) for name, value in scalars.items()}}


def printed(layer: int) -> Values:
    return {"layers_printed": np.asarray(layer)}


def test_print_without_a_known_surface_is_judged_by_its_shadow() -> None:
    rows: list[LayerRow] = []
    recorder = Recorder(JOB, {"printer": part(number("layers_printed")), "shadow": SHADOW}, rows.append)
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
        "printer": part(*([HEIGHT] if has_height else []), number("layers_printed")),
        "shadow": SHADOW,
        "profiler": part(MEASURED, number("layers_scanned"), is_device=is_device),
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
    printer = part(HEIGHT, number("layers_printed"), number("droplets_a"), Port("volume_lost", "m3"))
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

    parts = {"printer": part(HEIGHT, number("layers_printed"), number("droplets_a"))}
    whole, begun, resumed = (Recorder(JOB, parts) for _ in range(3))
    steps(whole, 0, 4)
    steps(begun, 0, 3)
    rows = begun.take_rows()
    assert begun.take_rows() == {}
    resumed.put_rows(rows)
    last: Values = {"height": flat(20.0), "droplets_a": np.asarray(10), **printed(2)}
    resumed.initialized(9 * SECOND, {"printer": last})
    assert resumed.layers == 2
    steps(resumed, 3, 4)
    both = resumed.maps([rows]).added_to(resumed.table())
    assert both.identical(whole.dataset())
    assert both.dtypes == whole.dataset().dtypes
    np.testing.assert_allclose(both.height[:, 1, 1], [0.0, DROPLET, 2 * DROPLET, 3 * DROPLET], rtol=1e-9)

"""Hardware against model: none where the device prints as the model, and the right cell where it does not."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from inkloop.cli import main
from inkloop.report import run_report
from inkloop.report.model_difference import LayerDifference, ModelDifference, _target, followed, model_difference
from inkloop.results.result import Result
from inkloop.tables.job import job_of
from inkloop.tables.schema import ScenarioFile
from support.benches.bench_run import BLOCK, printed_with_fmus, write

EXACT = {
    "components": {"printer": {"variation": 0.0}, "profiler": {"noise_std_um": 0.0, "dropout_rate": 0.0}},
    "substrate.tilt_x": 1e-3,
    "part.height_um": 9.0,
}
RESOLUTION = 0.1e-6
CELL = (5, 4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Result:
    """A print by devices that behave as the model, on a tilted substrate."""
    made = printed_with_fmus(write(tmp_path_factory.mktemp("exact")), EXACT)
    dataset = made.dataset.drop_vars("height").assign_attrs(scenario=BLOCK)
    return replace(made, dataset=dataset)


def with_error(run: Result, layer: int, error: float) -> Result:
    """One cell is scanned otherwise from a layer on."""
    maps = run.dataset.measured_height.values.copy()
    maps[layer:, CELL[0], CELL[1]] += error
    return replace(run, dataset=run.dataset.assign(measured_height=(("layer", "x", "y"), maps)))


def test_device_that_prints_as_the_model_predicts_differs_by_the_resolution(run: Result) -> None:
    found = model_difference(run)
    assert found is not None
    assert len(found.rows) == run.dataset.sizes["layer"] > 2
    assert all(abs(row.worst) <= RESOLUTION for row in found.rows)
    assert found.model == "LayerDeposition"
    whole = replace(run, dataset=run.dataset.assign(height=run.dataset.measured_height))
    going_on = replace(whole, dataset=whole.dataset.assign_attrs(stop_reason="running"))
    for result, is_known in ((whole, True), (going_on, False)):
        assert (run_report.Summary.of({"run": result}).difference is not None) == is_known


def test_worst_cell_is_found_and_its_growth_is_that_of_one_layer(run: Result) -> None:
    found = model_difference(with_error(run, 1, -3e-6))
    assert found is not None
    cells = int(run.dataset.mask.sum())
    for row in found.rows[1:]:
        assert row.cell == CELL
        assert row.worst == pytest.approx(-3e-6, abs=RESOLUTION)
        assert row.mean == pytest.approx(-3e-6 / cells, abs=RESOLUTION)
        assert row.rms == pytest.approx(3e-6 / np.sqrt(cells), abs=RESOLUTION)
    assert found.rows[1].growth == pytest.approx(3e-6 / np.sqrt(cells), abs=RESOLUTION)
    assert found.rows[2].growth <= RESOLUTION
    assert "worst cell (5, 4) -3.0" in found.sentence()


def test_cells_that_were_not_seen_do_not_count(run: Result) -> None:
    altered = with_error(run, 1, -3e-6)
    valid = altered.dataset.valid.values.copy()
    valid[:, CELL[0], CELL[1]] = False
    found = model_difference(replace(altered, dataset=altered.dataset.assign(valid=(("layer", "x", "y"), valid))))
    assert found is not None
    assert all(row.cell != CELL and abs(row.worst) <= RESOLUTION for row in found.rows)
    assert np.isnan(found.maps[:, CELL[0], CELL[1]]).all()
    outside = ~run.dataset.mask.values.astype(bool)
    assert valid[:, outside].any()
    assert np.isnan(found.maps[:, outside]).all()


def test_shadow_of_the_run_is_its_model(run: Result) -> None:
    shadow = run.dataset.measured_height.values - 2e-6
    found = model_difference(replace(run, dataset=run.dataset.assign(shadow_height=(("layer", "x", "y"), shadow))))
    assert found is not None
    assert found.model == "the shadow"
    assert all(row.mean == pytest.approx(2e-6, rel=1e-9, abs=0.0) for row in found.rows)


def test_model_prints_with_the_passes_of_the_printer_and_the_inks_of_the_run(run: Result) -> None:
    text = BLOCK.replace("[components.printer]\n", "[components.printer]\npasses = 1\n")
    assert text != BLOCK
    found = model_difference(replace(run, dataset=run.dataset.assign_attrs(scenario=text)))
    assert found is not None
    target = _target(run.dataset)
    job = job_of(ScenarioFile.model_validate(tomllib.loads(BLOCK)), target, "printer")
    for passes, atol in ((1, 1e-12), (4, 1e-8)):
        expected = run.dataset.measured_height.values - followed(run.dataset, replace(job, passes=passes))
        is_same = np.allclose(
            found.maps, np.where(np.isnan(found.maps), np.nan, expected), rtol=0.0, atol=atol, equal_nan=True
        )
        assert is_same == (passes == 1)
    assert target.inks == 1
    assert _target(run.dataset.assign(ink=run.dataset.pattern)).inks == 2


@pytest.mark.system
@pytest.mark.usefixtures("without_pictures")
def test_report_of_a_run_on_devices_has_a_row_for_each_layer(
    run: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    surface = run.dataset.assign(height=run.dataset.measured_height)  # as the recorder has it of a run on devices
    replace(run, dataset=surface).save(tmp_path)
    assert main(["report", str(tmp_path)]) == 0
    assert "Hardware minus LayerDeposition" in capsys.readouterr().out
    rows = re.findall(r"^ *\d+ .*,", (tmp_path / run_report.MODEL_TABLE).read_text("utf-8"), re.MULTILINE)
    assert len(rows) == run.dataset.sizes["layer"]
    assert (tmp_path / "hardware-against-model.png").stat().st_size > 10_000
    assert "hardware minus LayerDeposition" in (tmp_path / "summary.txt").read_text()


def test_print_of_models_has_no_such_table(tmp_path: Path) -> None:
    made = printed_with_fmus(write(tmp_path), {"part.height_um": 6.0})
    assert model_difference(made) is None


def test_difference_has_a_row_for_each_layer_in_micrometres() -> None:
    rows = (
        LayerDifference(0, -0.001e-6, 2e-6, float("nan"), -3.5e-6, (5, 4)),
        LayerDifference(3, 1.5e-6, 4e-6, 0.25e-6, 6.25e-6, (1, 0)),
        LayerDifference(4, 1.0e-6, 3e-6, 0.5e-6, 9.0e-6, (0, 2)),
    )
    found = ModelDifference("the shadow", np.zeros((5, 6, 6)), rows)
    assert found.farthest.layer == 3
    assert found.sentence() == (
        "hardware minus the shadow (hardware higher +, lower -): farthest in layer 3, mean +1.50, rms 4.00 µm, worst "
        "cell (1, 0) +6.25 µm"
    )
    table = found.table()
    assert list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True)) == [
        ("0", "+0.00", "2.00", "-", "-3.50", "5, 4"),
        ("3", "+1.50", "4.00", "0.25", "+6.25", "1, 0"),
        ("4", "+1.00", "3.00", "0.50", "+9.00", "0, 2"),
    ]
    assert [str(column.header).strip() for column in table.columns] == [
        "layer", "mean", "rms", "growth", "worst", "at cell",
    ]  # fmt: skip

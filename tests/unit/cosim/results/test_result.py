from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from inkloop.errors import ResultError
from inkloop.results.result import Result
from support.toys import DROPLET, toy_job, toy_result


@pytest.fixture
def result() -> Result:
    return toy_result()


def test_saved_run_reads_back_the_same(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path / "run")
    loaded = Result.load(tmp_path / "run")
    xr.testing.assert_identical(loaded.dataset, result.dataset)
    assert loaded.run == result.run
    assert loaded.scenario_text == result.scenario_text
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == ["result.nc", "run.json", "scenario.toml"]
    assert (tmp_path / "run" / "scenario.toml").read_text(encoding="utf-8") == result.scenario_text
    assert loaded.dataset.mask.dtype == np.bool_
    assert loaded.dataset.pattern.dtype == np.int32


def test_run_record_states_how_the_run_came_about(result: Result, tmp_path: Path) -> None:
    result.save(tmp_path)
    record = json.loads((tmp_path / "run.json").read_text())
    assert record["seed"] == 7
    assert record["stop_reason"] == "done"
    assert record["sha256"]["scenario"] == hashlib.sha256(result.scenario_text.encode()).hexdigest()
    assert {"numpy", "fmpy", "casadi", "python"} <= set(record["versions"])
    assert record["wall_s"]["total"] == result.wall_s > 0


@pytest.mark.parametrize(("writer", "is_printed"), [("run", True), ("run/compare/open", True), ("run/compare", False)])
def test_comparison_run_is_written_by_its_own_process_or_that_of_its_run(
    writer: str, is_printed: bool, result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "run" / "compare" / "open"
    Result.begin(folder, result.scenario_text, {"process": 0})
    monkeypatch.setattr("inkloop.results.result.writer_of", lambda place: "process 7" * (place == tmp_path / writer))
    words = "being printed by process 7; no layer is finished yet" if is_printed else "was not finished, its process"
    with pytest.raises(ResultError, match=words):
        Result.load(folder)


def test_figures_of_a_perfect_print(result: Result) -> None:
    figures = result.metrics()
    assert figures["layers"] == 3
    assert figures["droplets"] == 3 * toy_job().mask.sum()
    assert max(abs(figures[name]) for name in ("mean_error", "mae", "rms", "std", "min", "max")) < 1e-18
    assert float(result.final_height.max()) == pytest.approx(3 * DROPLET, rel=1e-9, abs=0.0)
    assert int(np.isfinite(result.error_map).sum()) == toy_job().mask.sum()


def test_spill_is_what_was_added_beside_the_part(result: Result) -> None:
    """On a start surface of 1 um: 2 um in one cell beside the part, -0.5 um in another, an unknown one."""
    run = result.dataset.copy(deep=True)
    run.height[0] = 1e-6
    run.height[-1] = np.where(run["mask"], 7e-6, 1e-6)
    run.height[-1, 0, 1], run.height[-1, 3, 0], run.height[-1, 3, 2] = 3e-6, 0.5e-6, np.nan
    figures = Result(run, result.run).metrics()
    assert figures["spill"] == pytest.approx(1.5e-6 * 1e-4**2, rel=1e-9, abs=0.0)
    assert figures["mean_error"] == pytest.approx(3 * DROPLET - 7e-6, rel=1e-9, abs=0.0)


def test_droplets_are_those_of_both_inks_as_counted_else_as_commanded(result: Result) -> None:
    run, cells = result.dataset.copy(deep=True), toy_job().mask.sum()
    run["droplets_b"] = run["droplets_a"] + 5
    assert Result(run, result.run).metrics()["droplets"] == 6 * cells + 5
    commanded = run.drop_vars(["droplets_a", "droplets_b"])
    assert Result(commanded, result.run).metrics()["droplets"] == 3 * cells
    assert np.isnan(Result(commanded.drop_vars("pattern"), result.run).metrics()["droplets"])


def test_folder_that_holds_no_such_run_is_refused_with_a_message(result: Result, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=r"holds no run\.json; name a folder that `inkloop run` has made"):
        Result.load(tmp_path)
    Result(result.dataset.assign_attrs(schema_version=99), result.run).save(tmp_path)
    with pytest.raises(ResultError, match="schema version is 99; this inkloop reads 1"):
        Result.load(tmp_path)
    (tmp_path / "result.nc").write_bytes(b"no netCDF")
    with pytest.raises(ResultError, match="cannot be read"):
        Result.load(tmp_path)

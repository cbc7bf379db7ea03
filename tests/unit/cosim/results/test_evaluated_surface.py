"""`[metrology]` of a scenario: its parameters in the result and in the summary, and what the command finds in a run."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.errors import ResultError
from inkloop.metrology.evaluation.table import parameters
from inkloop.printing.run import print_part
from inkloop.report import run_report
from inkloop.results.result import Result
from inkloop.results.surface import parameters_of, subject_of, surface
from inkloop.scenario.file import Scenario
from support.prints import quick_cuboid

WANTED = ["Sz", "Ssk", "flatness_mz", "step_height_ls", "volume_error", "droplets"]


def test_a_run_holds_what_its_scenario_asks_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = {"parameters": WANTED, "every_layer": True}
    noise = {"components.profiler.noise_std_um": 1.0}
    scenario = Scenario.load(quick_cuboid(), {"run.layers_max": 2, "metrology": table} | noise)
    print_part(scenario).save(tmp_path)
    run = Result.load(tmp_path).dataset
    mask, pitch = run.mask.values.astype(bool), float(run.attrs["pitch"])
    for layer in (0, 1, 2):
        z = run.height.values[layer]
        expected = {row.symbol: row for row in parameters(z, mask, pitch, target=run.target_height.values)}
        assert float(run.Sz[layer]) == pytest.approx(expected["Sz"].value, rel=1e-9, abs=0.0)
        error = (run.target_height.values - z)[mask].sum() * pitch**2
        assert float(run.volume_error[layer]) == pytest.approx(error, rel=1e-9, abs=0.0)
        assert float(run.droplets[layer]) == float(run.droplets_a[layer])
    assert (run.Sz.attrs["units"], run.volume_error.attrs["units"]) == ("m", "m3")
    assert run.Sz.attrs["treatment"] == "taken off: least-squares plane; no filter"
    assert run.flatness_mz.attrs["treatment"] == "nothing taken off; no filter"
    assert "positive: too little" in run.volume_error.attrs["long_name"]
    assert np.isnan(run.Ssk).values.tolist() == [True, False, False]  # a start surface without roughness has none
    assert "refused" not in run.Ssk.attrs
    assert np.isnan(run.step_height_ls).all()
    assert run.step_height_ls.attrs["refused"].startswith("16 cells with heights lie in the central third of the part")

    run_report.write(tmp_path, pictures=[])
    summary = " ".join((tmp_path / "summary.txt").read_text(encoding="utf-8").split())
    by_symbol = {row.symbol: row for row in parameters_of(run)}
    assert list(by_symbol) == WANTED
    assert by_symbol["volume_error"].value == float(run.volume_error[2])
    for symbol in ("Sz", "flatness_mz", "volume_error"):
        assert f"{by_symbol[symbol].shown:.6g}" in summary
    assert "step_height_ls: 16 cells with heights" in summary
    surface = run_report.record(tmp_path)["runs"]["closed loop"]["surface"]
    assert set(surface) >= {"Sz_um", "volume_error_nl", "droplets"}

    assert main(["metrology", str(tmp_path), "--layer", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["Sz_um"] == pytest.approx(float(run.Sz[1]) * 1e6, rel=1e-9, abs=0.0)
    assert found["volume_error_nl"] == pytest.approx(float(run.volume_error[1]) * 1e12, rel=1e-9, abs=0.0)
    assert found["mask"] == "part"
    assert main(["metrology", str(tmp_path), "--map", "measured", "--json"]) == 0
    (of_scan,) = (row for row in parameters(run.measured_height.values[2], mask, pitch) if row.symbol == "Sz")
    assert json.loads(capsys.readouterr().out)["Sz_um"] == pytest.approx(of_scan.value * 1e6, rel=1e-9, abs=0.0)
    assert of_scan.value != pytest.approx(float(run.Sz[2]), rel=1e-3, abs=0.0)
    subject = subject_of(run, "run", layer=1)
    assert subject.start is not None
    assert np.array_equal(subject.start, run.height.values[0])


def three_layers(source: str = "") -> xr.Dataset:
    """Surfaces of 10 um a layer and scans 1 um higher, of which one cell, another one in each layer, is not valid."""
    height = 10e-6 * np.arange(3.0)[:, None, None] * np.ones((3, 2, 3))
    valid = np.ones((3, 2, 3), np.bool_)
    valid[(0, 1, 2), (0, 1, 1), (0, 1, 2)] = False
    maps = {"height": height, "measured_height": height + 1e-6, "valid": valid}
    run = xr.Dataset({name: (("layer", "x", "y"), values) for name, values in maps.items()}, attrs={"pitch": 1e-4})
    run["mask"], run["target_height"] = (("x", "y"), [[True, True, False]] * 2), (("x", "y"), height[-1])
    run["droplets_a"], run["droplets_b"] = ("layer", [0, 5, 7]), ("layer", [0, 20, 40])
    run.height.attrs |= {"source": source} if source else {}
    return run


@pytest.mark.parametrize(
    ("source", "name", "is_scan"),
    [("", "printed", False), ("", "measured", True), ("measured_height", "printed", True)],
)
def test_cells_that_the_scan_of_the_layer_did_not_measure_have_no_height(source: str, name: str, is_scan: bool) -> None:
    run = three_layers(source)
    for layer, lost in ((1, [1, 1]), (2, [1, 2]), (None, [1, 2])):
        z = surface(run, "run", name=name, layer=layer).z
        assert np.argwhere(np.isnan(z)).tolist() == ([lost] if is_scan else [])
        assert (
            z[0, 0]
            == run[f"{'measured_' if name == 'measured' else ''}height"].values[2 if layer is None else layer, 0, 0]
        )


@pytest.mark.parametrize("layer", [-1, 3])
def test_layer_that_a_run_does_not_have_is_refused(layer: int) -> None:
    with pytest.raises(ResultError, match=rf"run: holds no layer {layer}; it has layers 0 \(the start surface\) to 2"):
        surface(three_layers(), "run", layer=layer)


@pytest.mark.parametrize(("layer", "droplets"), [(1, 25), (2, 47), (None, 47)])
def test_evaluated_scan_has_the_droplets_of_both_inks_and_stands_on_the_start_surface(
    layer: int | None, droplets: int
) -> None:
    subject = subject_of(three_layers(), "run", name="measured", layer=layer)
    assert subject.droplets == droplets
    np.testing.assert_array_equal(subject.start, np.zeros((2, 3)))

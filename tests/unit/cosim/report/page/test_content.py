"""Content of the page, its facts, tables, devices, maps and figures, against the numbers that they show."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.metrology.evaluation.definitions import Treatment
from inkloop.metrology.evaluation.table import parameters
from inkloop.report.page import charts
from inkloop.report.page.charts import ErrorScale
from inkloop.report.page.curves import by_layer, distribution, final_error
from inkloop.report.page.maps import (
    BYTES_OF_A_CELL_AND_LAYER,
    Blocks,
    LayerMaps,
    block_for,
    final_errors,
    packed,
    step_um,
)
from inkloop.report.page.page import ENDS, LOG_LINES, as_json, first_block, state
from inkloop.results.result import Result
from support.pages import HEIGHT, HOSTILE, MASK, PATTERN, TARGET, content_of, plate, shown, unpacked

HALF_A_STEP: dict[str, Any] = {"rtol": 0.0, "atol": 0.0051}


def test_page_has_the_facts_of_the_run_itself() -> None:
    found = shown(plate(), plate("open", mismatch=None))
    facts = dict(found["tables"]["facts"]["rows"])
    assert (facts["seed"], facts["grid"]) == ("11", "12 x 9 cells of 100 µm")
    assert (facts["wall time of total"], facts["event"]) == ("2.35 s", "layer 1: nozzle 5 is dead")
    assert len(facts["SHA-256 of scenario"]) == 64
    assert facts["version of numpy"] == np.__version__
    assert (found["texts"]["title"], found["texts"]["scenario"]) == ("Plate", "title = 'Plate'\n")
    assert found["texts"]["state"] == "The print ended at `layers_max` of the scenario: 2 layers."
    assert [(run["name"], run["inks"]) for run in found["runs"]] == [("closed loop", 2), ("open", 1)]
    table = found["tables"]["table"]
    assert "mean error" in table["headings"]
    assert "too low +, too high -" in table["caption"]
    assert found["runs"][0]["charts"]["solid"]["layout"]["scene"]["zaxis"]["range"] == [0.0, pytest.approx(22.0, abs=2)]


def test_page_evaluates_the_last_surface_of_the_part() -> None:
    found = shown(plate())["tables"]["metrology"]
    expected = {row.symbol: row for row in parameters(HEIGHT, MASK, 1e-4, target=TARGET, treatment=Treatment("target"))}
    rows = {symbol: (name, value) for symbol, name, value in found["rows"]}
    assert rows["Sq"] == (expected["Sq"].name, f"{expected['Sq'].value * 1e6:.4g} µm")
    assert rows["Ssk"][1] == f"{expected['Ssk'].value:.4g}"  # a ratio has no unit
    assert set(rows) == {"Sa", "Sq", "Sp", "Sv", "Sz", "Ssk", "Sku", "Sdq", "Sdr"}
    assert found["caption"] == "last layer, over the part; taken off: target height, then the mean; no filter"


@pytest.mark.parametrize("block", [1, 2])
def test_page_has_the_plan_of_each_layer(block: int) -> None:
    """Droplets in tenths; of blocks, which are smaller at the edge, the mean."""
    planned = np.random.default_rng(5).integers(0, 6, PATTERN.shape).astype(np.int8)
    planned[2, 3, 4], planned[2, 8, 8] = 5, 5
    of_run, without = shown(plate(planned_droplets=(("layer", "x", "y"), planned)), plate("open"), block=block)["runs"]
    found = unpacked(of_run["layers"]["planned"]) / 10.0
    assert found[2, 8 // block, 8 // block] == pytest.approx(planned[2, 8 : 8 + block, 8:].mean(), abs=0.0501)
    assert found[2, 3 // block, 4 // block] != found[1, 3 // block, 4 // block]
    assert of_run["charts"]["plan"]["layout"]["coloraxis"]["cmax"] == np.ceil(found.max())
    assert "planned" not in without["layers"]
    assert "plan" not in without["charts"]


def test_state_says_how_the_print_ended() -> None:
    for reason, sentence in ENDS.items():
        ended = Result(plate().dataset.assign_attrs(stop_reason=reason), {})
        assert state(ended) == f"{sentence}: 2 layers."
    assert state(Result(ended.dataset.isel(layer=slice(2)), {})).endswith(": 1 layer.")


def test_last_message_of_each_node_is_shown_with_its_level(tmp_path: Path) -> None:
    log = tmp_path / "bench.log"
    assert "nodes" not in shown(plate(), log=log)["tables"]
    old = [f"2026-01-01 10:00:{n % 60:02d} INFO stage: line {n}" for n in range(50)]
    lines = [
        *old,
        "2026-01-01 11:00:00 WARNING lamp: warm: 3 A",
        "2026-01-01 11:00:01 INFO stage: at rest",
        "2026-01-01 11:00:02 ERROR not a node: words",
        "cut off",
    ]
    log.write_text("\n".join(lines), encoding="utf-8")
    found = shown(plate(), log=log)
    assert found["tables"]["nodes"]["rows"] == [
        ["stage", "2026-01-01 11:00:01", "", "at rest"],
        ["lamp", "2026-01-01 11:00:00", "warning", "warm: 3 A"],
    ]
    assert found["texts"]["log"] == "\n".join(lines[-LOG_LINES:])


def test_edges_and_final_errors_are_those_of_the_run() -> None:
    (run,) = shown(plate())["runs"]
    edges = [(np.arange(cells + 1) - 0.5) * 0.1 for cells in MASK.shape]
    for found, expected in zip(run["edges"], edges, strict=True):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9)
    errors = unpacked(run["final"]["errors"]) * run["step"]
    np.testing.assert_allclose(errors, np.where(MASK, (TARGET - HEIGHT) * 1e6, 0.0), **HALF_A_STEP)
    coarse = final_errors(plate().dataset, 30)
    part = unpacked(coarse["part"]).astype(bool)
    assert (part.shape, [len(each) - 1 for each in coarse["edges"]]) == ((6, 5), [6, 5])
    assert coarse["edges"][1] == pytest.approx([-0.05, 0.15, 0.35, 0.55, 0.75, 0.85], rel=1e-9, abs=0.0)
    corner = (TARGET - HEIGHT)[2:4, 1:2].mean() * 1e6  # of this block two cells are of the part
    assert unpacked(coarse["errors"])[1, 0] * 0.01 == pytest.approx(corner, abs=0.0051)


@pytest.mark.parametrize("block", [2, 5])
def test_blocks_hold_the_means_of_their_cells_and_on_its_edge_those_of_the_part(block: int) -> None:
    run = plate().dataset
    maps = LayerMaps(run, block)
    assert maps.blocks.shape == tuple(-(-cells // block) for cells in MASK.shape)
    for i, j in np.ndindex(maps.blocks.shape):
        cells = np.s_[i * block : (i + 1) * block, j * block : (j + 1) * block]
        counted = MASK[cells] if MASK[cells].any() else np.ones_like(MASK[cells])
        assert maps.blocks.part[i, j] == MASK[cells].any()
        for layer in (0, 2):
            mean = run.height.values[layer][cells][counted].mean() * 1e6
            assert maps.heights[layer, i, j] * maps.step_um == pytest.approx(mean, rel=0.0, abs=0.0051)
        share = (run.pattern.values[2][cells] != 0).mean() * 100.0
        assert abs(maps.droplets[2, i, j] - share) <= 0.5


def test_layer_that_was_not_scanned_yet_gets_its_heights_with_the_next_one() -> None:
    run = plate().dataset
    so_far = run.isel(layer=slice(2)).copy(deep=True)
    so_far["height"][1] = np.nan
    maps = LayerMaps(so_far, 1)
    np.testing.assert_array_equal(maps.heights[1], maps.heights[0])
    maps.extend(run)
    np.testing.assert_array_equal(maps.heights, LayerMaps(run, 1).heights)
    rest = unpacked(maps.packed(2)["heights"])
    np.testing.assert_array_equal(rest, maps.heights[2:] - maps.heights[1:2])
    late = run.copy(deep=True)
    late["height"][2] = np.nan
    np.testing.assert_array_equal(LayerMaps(late, 1).heights, maps.heights[[0, 1, 1]])


def test_range_of_heights_has_the_ground_and_the_target() -> None:
    raised, low = (plate().dataset.copy(deep=True) for _ in range(2))
    raised["height"] = raised["height"] + 5e-6
    raised["target_height"] = raised["target_height"] + 5e-6
    assert LayerMaps(raised, 1).range_um[0] == 0.0
    low["height"] = 0.5 * low["height"]
    assert LayerMaps(low, 1).range_um[1] == pytest.approx(20.0, rel=1e-6, abs=0.0)


def test_blocks_leave_room_for_the_layers_that_will_come() -> None:
    runs, room = {"a": plate()}, 3.0 * BYTES_OF_A_CELL_AND_LAYER * MASK.size
    assert [first_block(runs, room, layers) for layers in (0, 3, 4)] == [1, 1, 2]


def test_content_has_no_markup() -> None:
    text = as_json({"title": HOSTILE})
    assert not set("<>&") & set(text)
    assert json.loads(text) == {"title": HOSTILE}


def test_heights_of_tall_parts_have_coarser_steps_and_large_maps_larger_blocks() -> None:
    run = plate().dataset
    assert step_um(run) == 0.01
    tall = run.copy(deep=True)
    tall["target_height"] = tall["target_height"] * 25_000.0
    assert 0.5e6 / step_um(tall) < 2**31  # a height of half a metre fits
    grid = xr.Dataset({"height": (("layer", "x", "y"), np.zeros((1, 10, 7)))})
    assert [block_for(grid, cells) for cells in (70, 69, 20, 0.5)] == [1, 2, 2, 10]
    assert Blocks(np.ones((10, 7), np.bool_), 10).shape == (1, 1)


def test_numbers_take_the_smallest_type_that_holds_them() -> None:
    for values, name in (([-128, 127], "int8"), ([-129, 0], "int16"), ([0, 128], "int16"), ([0, 40000], "int32")):
        found = packed(np.array([values], np.int64))
        assert (found["type"], tuple(found["shape"])) == (name, (2, 1))
        np.testing.assert_array_equal(unpacked(found), [values])


def test_report_writes_one_file_and_says_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plate().save(tmp_path)
    assert main(["report", str(tmp_path), "--html", "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert (found["folder"], found["file"]) == (str(tmp_path), str(tmp_path / "report.html"))
    assert found["runs"]["closed loop"]["layers"] == 2
    size = (tmp_path / "report.html").stat().st_size / 2**20
    assert f"report.html: {size:.3g} MiB" in told.err
    assert content_of((tmp_path / "report.html").read_text(encoding="utf-8"))["texts"]["title"] == "Plate"
    assert not (tmp_path / "summary.txt").exists()
    assert main(["report", str(tmp_path), "--no-pictures", "--json"]) == 0
    assert set(json.loads(capsys.readouterr().out)) == {"folder", "runs"}
    assert (tmp_path / "summary.txt").read_text(encoding="utf-8").startswith("Plate")


def printed(*errors_um: float, layers: int = 3, mean_um: float = -2.0, std_um: float = 4.0) -> xr.Dataset:
    """A part of so many cells and one beside it; `errors_um` at its end. Each layer has one droplet more."""
    cells = len(errors_um) + 1
    mask = np.arange(cells)[:, None] > 0
    height = np.zeros((layers + 1, cells, 1))
    height[-1, 1:, 0] = 50e-6 - np.array(errors_um) * 1e-6
    pattern = np.zeros(height.shape, np.int32)
    for layer in range(1, layers + 1):
        pattern[layer, :layer] = 2
    means, stds = np.linspace(50e-6, mean_um * 1e-6, layers + 1), np.linspace(0.0, std_um * 1e-6, layers + 1)
    maps = {name: (("layer", "x", "y"), values) for name, values in {"height": height, "pattern": pattern}.items()}
    flat = {"target_height": (("x", "y"), np.where(mask, 50e-6, 0.0)), "mask": (("x", "y"), mask)}
    figures = {"mean_error": ("layer", means), "std": ("layer", stds)}
    return xr.Dataset({**maps, **flat, **figures}, {"layer": np.arange(layers + 1)}, {"pitch": 1e-4})


def test_curves_by_layer_are_distance_unevenness_and_droplets_under_their_headings() -> None:
    figure = by_layer({"closed": printed(1.0, 2.0, 3.0), "open <b>": printed(1.0, 2.0, 3.0)})
    mean, std, droplets = figure.data[:3]
    np.testing.assert_array_equal(mean.x, [0, 1, 2, 3])
    np.testing.assert_allclose(mean.y, [50.0, 98 / 3, 46 / 3, 2.0], rtol=1e-9)  # a distance has no sign
    np.testing.assert_array_equal(std.x, [1, 2, 3])
    np.testing.assert_allclose(std.y, [4 / 3, 8 / 3, 4.0], rtol=1e-9)
    np.testing.assert_array_equal([droplets.x, droplets.y], [[1, 2, 3], [1, 2, 3]])
    assert [trace.name for trace in figure.data] == ["closed"] * 3 + ["open &lt;b&gt;"] * 3
    assert [trace.showlegend for trace in figure.data] == [True, False, False] * 2
    lines = [trace.line for trace in figure.data]
    assert lines[0] == lines[1] != lines[3] == lines[4]
    assert (lines[0].dash, lines[2].shape) == ("solid", "hvh")
    layout, axes = figure.layout, ("y", "y2", "y3")
    assert [trace.yaxis for trace in figure.data[:3]] == list(axes)
    for axis, heading in zip(("yaxis", "yaxis2", "yaxis3"), layout.annotations, strict=True):
        assert layout[axis].domain[1] == heading.y  # each stands above its own curves
    assert [heading.text.partition(" ")[0] for heading in layout.annotations] == ["distance", "standard", "droplets"]
    assert (layout.yaxis.type, layout.yaxis2.type, layout.yaxis3.type) == ("log", "log", None)
    assert (layout.xaxis3.title.text, layout.xaxis3.dtick) == ("layer", 1)  # a tick for each of few layers
    assert by_layer({"a": printed(1.0, layers=12)}).layout.xaxis3.dtick is None
    bare = by_layer({"a": printed(1.0, std_um=0.0).drop_vars("pattern")})
    assert (len(bare.data), bare.layout.yaxis2.type) == (2, None)


def test_run_keeps_its_colour_where_another_one_is_left_out_of_the_distribution() -> None:
    near, far = np.linspace(-1.0, 1.0, 9), np.linspace(900.0, 1000.0, 9)
    of_all = {trace.name: trace.line.color for trace in distribution({"a": near, "b": near, "c": near}).data}
    found = {trace.name: trace.line.color for trace in distribution({"a": near, "b": far, "c": near}).data}
    assert found == {name: of_all[name] for name in ("a", "c")}


def test_distribution_counts_the_cells_of_the_part_and_names_a_run_that_is_far_off() -> None:
    errors = [-1.0] * 3 + [0.5] * 5 + [2.0] * 2
    figure = distribution({"a": final_error(printed(*errors)), "b": final_error(printed(*[1.0] * 9))})
    first, second = figure.data
    assert sum(first.y) == pytest.approx(100.0, rel=1e-9, abs=0.0)
    assert float(first.x @ first.y) / 100.0 == pytest.approx(float(np.mean(errors)), abs=0.05)
    assert sorted(first.y[first.y > 0]) == pytest.approx([20.0, 30.0, 50.0], rel=1e-9, abs=0.0)
    assert first.y[np.abs(first.x + 1.0) < 0.05].sum() == pytest.approx(30.0, rel=1e-9, abs=0.0)
    assert second.x[int(np.argmax(second.y))] == pytest.approx(1.0, abs=0.05)
    assert (first.fill, second.fill) == ("tozeroy", "none")
    assert figure.layout.xaxis.title.text == "target - height [µm]<br>- too high, + too low"
    near, far = np.linspace(-1.0, 1.0, 30), np.linspace(20.0, 40.0, 30)
    figure = distribution({"near": near, "open": far, "empty": np.zeros(0)})
    assert [trace.name for trace in figure.data] == ["near"]
    assert max(abs(figure.data[0].x)) < 2.0
    assert figure.layout.xaxis.title.text.endswith("<br>outside: open: +30 µm")


def test_scale_of_errors_is_that_of_all_runs_with_round_numbers_on_both_sides() -> None:
    fine, coarse = np.linspace(-1.0, 1.0, 1001), np.linspace(-40.0, 10.0, 1001)
    scale = ErrorScale.of([fine, coarse])
    far = [np.quantile(np.abs(errors), 0.99) for errors in (fine, coarse)]
    assert (scale.width, scale.limit) == pytest.approx((far[0] / 2.0, far[1]), rel=1e-9, abs=0.0)
    axis = ErrorScale(0.7, 30.0).coloraxis
    texts = axis["colorbar"]["ticktext"]
    assert texts == ["-20", "-5", "-1", "0", "1", "5", "20"]
    np.testing.assert_allclose(axis["colorbar"]["tickvals"], np.arcsinh(np.array(texts, float) / 0.7), rtol=1e-12)
    np.testing.assert_allclose([axis["cmin"], axis["cmax"]], np.arcsinh([-30 / 0.7, 30 / 0.7]), rtol=1e-12)
    assert (axis["colorscale"][0], axis["colorscale"][-1]) == ("#67001f", "#053061")
    assert ErrorScale.of([np.zeros(0)]).limit > 0.0
    assert ErrorScale.of([np.full(9, 0.01), np.full(9, 800.0)]).width == pytest.approx(2.0, rel=1e-9, abs=0.0)
    exact = distribution({"exact": np.zeros(9), "near": np.ones(9)})
    assert [line.name for line in exact.data] == ["exact", "near"]
    (level,) = distribution({"level": np.full(9, 3.0)}).data
    assert level.x[0] < 3.0 < level.x[-1]


@pytest.mark.parametrize(
    ("inks", "words", "ends"),
    [(1, ["none", "droplet"], (-0.5, 1.5)), (2, ["none", "ink A", "ink B"], (-0.5, 2.5)), (0, None, (0, 100))],
)
def test_droplets_are_shown_by_ink_or_as_a_share_of_their_block(inks: int, words: Any, ends: Any) -> None:
    colours = charts.droplets(inks).layout.coloraxis
    assert (colours.cmin, colours.cmax) == ends
    assert colours.colorbar.ticktext == (tuple(words) if words else None)
    shares = [0.0, *(at / len(words) for at in range(1, len(words)) for _ in "ab"), 1.0] if words else [0.0, 1.0]
    assert [at for at, _ in colours.colorscale] == pytest.approx(shares, rel=1e-12, abs=0.0)


def test_solid_is_as_long_as_the_grid_and_says_how_much_heights_are_stretched() -> None:
    edges = [[-0.05, 0.95, 1.95], [-0.05, 0.45, 0.95]]  # 2 mm x 1 mm
    figure = charts.solid(ErrorScale(0.1, 1.0), (0.0, 50.0), edges)
    scene = figure.layout.scene
    assert scene.aspectratio.x == pytest.approx(2.0 * scene.aspectratio.y, rel=1e-9, abs=0.0)
    assert (scene.xaxis.range, scene.yaxis.range, scene.zaxis.range) == ((-0.05, 1.95), (-0.05, 0.95), (0.0, 50.0))
    stretch = scene.aspectratio.z / 50e-6 / (scene.aspectratio.x / 2e-3)
    assert figure.layout.title.text == f"Surface in 3D, heights \u00d7 {stretch:.2g}"

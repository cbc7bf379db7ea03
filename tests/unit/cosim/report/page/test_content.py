"""The page as a file: its facts, its table of the surface, and the command that writes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.cli import main
from inkloop.metrology.evaluation.table import parameters
from inkloop.report.page.content import content
from inkloop.report.page.maps import LayerMaps, final_errors, packed
from inkloop.results.result import Result
from support.page_scripts import drawn, needs_node
from support.pages import content_of, unpacked

MASK = np.zeros((12, 9), np.bool_)
MASK[2:10, 1:8] = True
HEIGHT = np.where(MASK, 20e-6 + np.random.default_rng(3).normal(0.0, 1e-6, MASK.shape), 0.0)
TARGET = np.where(MASK, 20e-6, 0.0)


def printed(label: str = "closed loop", **more: Any) -> Result:
    height = np.stack([np.zeros_like(HEIGHT), HEIGHT / 2, HEIGHT])
    dataset = xr.Dataset(
        {
            "height": (("layer", "x", "y"), height),
            "target_height": (("x", "y"), TARGET),
            "mask": (("x", "y"), MASK),
            "mean_error": ("layer", [20e-6, 10e-6, 1e-7]),
            "std": ("layer", [0.0, 5e-7, 1e-6]),
            **more,
        },
        {"layer": np.arange(3), "x": np.arange(12) * 1e-4, "y": np.arange(9) * 1e-4},
        {"pitch": 1e-4},
    )
    return Result.of(
        dataset, title="Plate", label=label, scenario_text="title = 'Plate'\n", seed=11, stop_reason="layers_max",
        wall_s={"total": 2.345}, components={}, notes={"events": ["layer 1: nozzle 5 is dead"]},
    )  # fmt: skip


def shown(*runs: Result, **options: Any) -> dict[str, Any]:
    named = {result.dataset.attrs["label"]: result for result in runs}
    return content(named, [LayerMaps(result.dataset, 1) for result in runs], cells=1e6, **options)


def test_page_has_the_facts_of_the_run_itself() -> None:
    found = shown(printed(), printed("open"))
    facts = dict(found["facts"])
    assert (facts["seed"], facts["grid"]) == ("11", "12 x 9 cells of 100 µm")
    assert (facts["wall time of total"], facts["event"]) == ("2.35 s", "layer 1: nozzle 5 is dead")
    assert len(facts["SHA-256 of scenario"]) == 64
    assert facts["version of numpy"] == np.__version__
    assert (found["title"], found["scenario"]) == ("Plate", "title = 'Plate'\n")
    assert found["state"] == "The print ended at `layers_max` of the scenario: 2 layers."
    assert [run["name"] for run in found["runs"]] == ["closed loop", "open"]
    assert [run["inks"] for run in found["runs"]] == [1, 1]
    assert shown(printed(mismatch=0.25))["runs"][0]["inks"] == 2
    assert "mean error" in found["table"]["headings"]
    assert "too low +, too high -" in found["table"]["caption"]


def test_page_evaluates_the_last_surface_of_the_part() -> None:
    found = shown(printed())["metrology"]
    expected = {row.symbol: row for row in parameters(HEIGHT, MASK, 1e-4, target=TARGET)}
    rows = {symbol: (name, value) for symbol, name, value in found["rows"]}
    assert rows["Sq"] == (expected["Sq"].name, f"{expected['Sq'].value * 1e6:.4g} µm")
    assert rows["Ssk"][1] == f"{expected['Ssk'].value:.4g}"  # a ratio has no unit
    assert set(rows) == {"Sa", "Sq", "Sp", "Sv", "Sz", "Ssk", "Sku", "Sdq", "Sdr"}
    assert found["caption"] == "last layer, over the part; taken off: least-squares plane; no filter"


def test_page_gets_only_the_layers_that_it_lacks() -> None:
    later = shown(printed(), printed("open"), known=[2])["runs"]
    assert [run["layers"]["first"] for run in later] == [1, 0]
    steps = unpacked(later[0]["layers"]["heights"]).astype(np.int64)
    np.testing.assert_allclose(steps[1] * later[0]["step_um"], HEIGHT * 0.5e6, atol=0.0101)
    assert shown(printed(), known=[99])["runs"][0]["layers"]["first"] == 2
    assert shown(printed(), known=[0])["runs"][0]["layers"]["first"] == 0


def test_grid_and_final_errors_are_those_of_the_run() -> None:
    (run,) = shown(printed())["runs"]
    assert (run["grid"], run["block"], tuple(run["shape"]), run["pitch_mm"]) == ([12, 9], 1, (12, 9), 0.1)
    errors = unpacked(run["final"]["errors"]) * run["step_um"]
    np.testing.assert_allclose(errors, np.where(MASK, (TARGET - HEIGHT) * 1e6, 0.0), atol=0.0051)
    coarse = final_errors(printed().dataset, 30)
    assert (coarse["block"], tuple(coarse["shape"])) == (2, (6, 5))
    part = unpacked(coarse["part"]).astype(bool)
    np.testing.assert_array_equal(
        part, [[MASK[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].any() for j in range(5)] for i in range(6)]
    )
    corner = (TARGET - HEIGHT)[2:4, 1:2].mean() * 1e6  # of this block two cells are of the part
    assert unpacked(coarse["errors"])[1, 0] * 0.01 == pytest.approx(corner, abs=0.0051)


@pytest.mark.parametrize(
    ("values", "name"), [([-128, 127], "int8"), ([-129, 0], "int16"), ([0, 128], "int16"), ([0, 40000], "int32")]
)
def test_numbers_take_the_smallest_type_that_holds_them(values: list[int], name: str) -> None:
    found = packed(np.array([values], np.int64))
    assert (found["type"], tuple(found["shape"])) == (name, (1, 2))
    np.testing.assert_array_equal(unpacked(found), [values])


def test_report_writes_one_file_and_says_where(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    printed().save(tmp_path)
    assert main(["report", str(tmp_path), "--html", "--json"]) == 0
    told = capsys.readouterr()
    found = json.loads(told.out)
    assert (found["folder"], found["file"]) == (str(tmp_path), str(tmp_path / "report.html"))
    assert found["runs"]["closed loop"]["layers"] == 2
    size = (tmp_path / "report.html").stat().st_size / 2**20
    assert f"report.html: {size:.3g} MiB" in told.err
    assert content_of((tmp_path / "report.html").read_text(encoding="utf-8"))["title"] == "Plate"
    assert not (tmp_path / "summary.txt").exists()
    assert main(["report", str(tmp_path), "--no-pictures", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) == {"folder", "runs"}
    assert (tmp_path / "summary.txt").read_text(encoding="utf-8").startswith("Plate")


def test_further_layers_count_from_the_last_one_that_the_page_has() -> None:
    run = printed().dataset
    maps = LayerMaps(run, 1)
    steps = unpacked(maps.packed(2)["heights"]).astype(np.int64)
    grown = (run.height[2] - run.height[1]).values
    np.testing.assert_allclose(steps[0] * maps.step_um, grown * 1e6, rtol=0.0, atol=1.01 * maps.step_um)


def means(values: Any, block: int = 2) -> Any:
    """Over blocks of cells, which are smaller at the far edges."""
    nx, ny = (-(-cells // block) for cells in values.shape)
    places = [[np.s_[block * i : block * (i + 1), block * j : block * (j + 1)] for j in range(ny)] for i in range(nx)]
    return np.array([[np.nanmean(values[place]) if np.isfinite(values[place]).any() else np.nan for place in row]
                     for row in places])  # fmt: skip


@needs_node
@pytest.mark.system
def test_page_draws_the_heights_and_errors_of_the_run() -> None:
    """On a grid that is not square; row and column of a cell, and its read-out in two layers."""
    pattern = np.zeros((3, 12, 9), np.int32)
    pattern[1:, 2:10, 1:8] = 1
    (run,) = shown(printed(pattern=(("layer", "x", "y"), pattern)))["runs"]
    i, j = np.argwhere(HEIGHT > TARGET)[1]
    found = drawn(run, f"""
        const cell = {{ i: {i}, j: {j} }}, scale = new ErrorScale([run]);
        const cuts = ["x", "y"].map((along) => sectionChart(run, 2, cell, along));
        const [body, tops] = solidChart(run, 2, scale, false).data;
        const surface = surfaceChart(run, 2, cell, 25), error = layerErrorChart(run, 2, cell, scale);
        return {{
          surface: surface.data[0], ring: surface.layout.shapes[0], errors: error.data[0].customdata,
          droplets: dropletChart(run, 1, cell).data[0].z, final: finalChart(run, scale).data[0].customdata,
          cuts: cuts.map(({{ data: [before, ...lines], layout }}) => ({{ title: layout.title.text, before, lines }})),
          body, tops, coarser: coarser(run, 2, 2), readouts: [1, 2].map((layer) => readout(run, layer, cell)),
          scale: [scale.width, scale.limit], wide: run.grid.map((cells) => [edges(cells, 5, 1), middles(cells, 5, 1)]),
        }};
    """)  # fmt: skip
    um, error = HEIGHT * 1e6, np.where(MASK, (TARGET - HEIGHT) * 1e6, np.nan)
    half: dict[str, Any] = {"rtol": 0.0, "atol": 0.0051}
    edges = [(np.arange(cells + 1) - 0.5) * 0.1 for cells in (12, 9)]
    np.testing.assert_allclose(found["surface"]["z"], um.T, **half)
    for axis, expected in zip("xy", edges, strict=True):
        np.testing.assert_allclose(found["surface"][axis], expected, rtol=0.0, atol=1e-12)
    ring = [found["ring"][name] for name in ("x0", "x1", "y0", "y1")]
    assert ring == pytest.approx([0.1 * i - 0.05, 0.1 * i + 0.05, 0.1 * j - 0.05, 0.1 * j + 0.05], rel=1e-9, abs=0.0)
    for name in ("errors", "final"):
        np.testing.assert_allclose(np.array(found[name], float), error.T, **half)
    np.testing.assert_array_equal(found["droplets"], pattern[1].T)
    for cut, title, place, line in zip(
        found["cuts"],
        (f"Cut at y = {0.1 * j:.2f} mm", f"Cut at x = {0.1 * i:.2f} mm"),
        (np.arange(12) * 0.1, np.arange(9) * 0.1),
        (np.s_[:, j], np.s_[i, :]),
        strict=True,
    ):
        assert cut["title"] == title
        earlier = np.array(cut["before"]["y"], float).reshape(2, -1)  # each layer ends in a gap
        np.testing.assert_allclose(earlier[:, :-1], [0.0 * um[line], um[line] / 2], **half)
        for shown_line, values in zip(cut["lines"], (TARGET * 1e6, um, error), strict=True):
            np.testing.assert_allclose(shown_line["x"], place, rtol=0.0, atol=1e-12)
            np.testing.assert_allclose(np.array(shown_line["y"], float), values[line], **half)
    corners = np.array([found["body"][axis] for axis in "xyz"]).reshape(3, 12, 9, 4)
    np.testing.assert_allclose(corners[0].mean(axis=-1), np.indices((12, 9))[0] * 0.1, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(corners[1].mean(axis=-1), np.indices((12, 9))[1] * 0.1, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(np.ptp(corners, axis=-1)[:, 0, 0], [0.1, 0.1, 0.0], rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(corners[2, ..., 0], um, **half)
    assert len(found["tops"]["intensity"]) == len(found["tops"]["i"]) == 2 * MASK.sum()
    for name, values in (("heights", um), ("errors", error)):
        np.testing.assert_allclose(np.array(found["coarser"][name], float).reshape(6, 5), means(values), **half)
    assert found["wide"] == [[[-0.5, 4.5, 9.5, 11.5], [2.0, 7.0, 10.5]], [[-0.5, 4.5, 8.5], [2.0, 6.5]]]
    deviations = np.sort(np.abs(error[MASK]))
    limit = deviations[int(0.99 * len(deviations))]
    np.testing.assert_allclose(found["scale"], [limit / 2, limit], **half)
    begin = f"Cell ({i}, {j}) at x {0.1 * i:.3f} mm, y {0.1 * j:.3f} mm, layer "
    for layer, height, side in ((1, um[i, j] / 2, "low"), (2, um[i, j], "high")):
        seen = round(height, 2)
        end = f"target 20.00 µm: {abs(20.0 - seen):.2f} µm too {side}; a droplet."
        assert found["readouts"][layer - 1] == f"{begin}{layer}: height {seen:.2f} µm, {end}"


@needs_node
@pytest.mark.system
def test_open_page_takes_the_layers_that_it_lacks() -> None:
    """Layer 1 was scanned since the page got it, and layer 2 was printed."""
    known, whole = printed().dataset.isel(layer=slice(2)), printed()
    maps, scanned = LayerMaps(known, 1), known.height[1] + 1e-6
    whole.dataset["height"][1] = scanned
    begun = {"name": "run", **maps.described(known), "layers": maps.packed(), "final": final_errors(known, 1e6)}
    (later,) = shown(whole, known=[2])["runs"]
    assert later["layers"]["first"] == 1
    code = "return [run.layers, run.jetted.length, [0, 1, 2].map((layer) => run.heights(layer))];"
    layers, jetted, heights = drawn(begun | {"later": later}, f"await run.add(given.later); {code}")
    assert (layers, jetted) == (3, 3)
    for found, expected in zip(heights, (0.0 * HEIGHT, scanned.values, HEIGHT), strict=True):
        np.testing.assert_allclose(np.reshape(found, MASK.shape), expected * 1e6, rtol=0.0, atol=0.0051)


@needs_node
@pytest.mark.system
def test_page_draws_a_layer_of_more_cells_than_a_call_takes_arguments() -> None:
    cells = np.zeros((401, 390))
    dataset = xr.Dataset(
        {
            "height": (("layer", "x", "y"), np.stack([cells, cells + 9e-6])),
            "target_height": (("x", "y"), cells + 20e-6),
            "mask": (("x", "y"), np.ones_like(cells, np.bool_)),
        },
        {"layer": np.arange(2), "x": np.arange(401) * 1e-4, "y": np.arange(390) * 1e-4},
        {"pitch": 1e-4},
    )

    maps, final = LayerMaps(dataset, 1), final_errors(dataset, 1e6)
    run = {"name": "large", **maps.described(dataset), "layers": maps.packed(), "final": final, "inks": 1}
    layer = "page.runs = [run]; page.scale = new ErrorScale([run]); page.layer = 1; await showLayer();"
    click = 'find("error").click({ points: [{ pointIndex: [7, 300] }] });'  # row and column of Plotly
    top, cell, text = drawn(
        run, f'{layer} {click} return [find("surface").data[0].zmax, page.cell, find("readout").textContent];'
    )
    assert top == pytest.approx(20.0, rel=1e-6, abs=0.0)
    assert cell == {"i": 300, "j": 7}
    assert text == (
        "Cell (300, 7) at x 30.000 mm, y 0.700 mm, layer 1: height 9.00 µm, target 20.00 µm: 11.00 µm too low; "
        "no droplet."
    )

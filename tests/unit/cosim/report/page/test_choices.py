"""Choices of a user on the page and the values shown: layers, cells, runs, cuts, and further layers of a print."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.results.result import Result
from support.page_scripts import drawn, needs_node
from support.pages import HEIGHT, MASK, PATTERN, TARGET, plate, shown

pytestmark = [needs_node, pytest.mark.system]

UM, ERROR = HEIGHT * 1e6, np.where(MASK, (TARGET - HEIGHT) * 1e6, np.nan)
HALF: dict[str, Any] = {"rtol": 0.0, "atol": 0.0051}
EXACT: dict[str, Any] = {"rtol": 0.0, "atol": 1e-9}
EDGES = [(np.arange(cells + 1) - 0.5) * 0.1 for cells in MASK.shape]


def means(values: Any, block: int = 2) -> Any:
    """Over blocks of cells, which are smaller at the far edges."""
    nx, ny = (-(-cells // block) for cells in values.shape)
    places = [[np.s_[block * i : block * (i + 1), block * j : block * (j + 1)] for j in range(ny)] for i in range(nx)]
    return np.array([[np.nanmean(values[place]) if np.isfinite(values[place]).any() else np.nan for place in row]
                     for row in places])  # fmt: skip


def test_maps_are_the_heights_droplets_and_errors_of_the_layer_around_a_ring() -> None:
    found = drawn(shown(plate()), """
        await show(2, 3, 5);
        return ["surface", "droplets", "error"].map((id) => [find(id).data[0], find(id).layout.shapes[0]])
          .concat([[find("finals").children[0].data[0], content.width]]);
    """)  # fmt: skip
    (surface, ring), (droplets, _), (error, _), (final, width) = found
    np.testing.assert_allclose(surface["z"], UM.T, **HALF)
    np.testing.assert_array_equal(droplets["z"], PATTERN[2].T)
    for trace in (error, final):
        np.testing.assert_allclose(np.array(trace["customdata"], float), ERROR.T, **HALF)
        np.testing.assert_allclose(np.sinh(np.array(trace["z"], float)) * width, ERROR.T, **HALF)
    for trace in (surface, droplets, error, final):
        np.testing.assert_allclose(np.concatenate([trace["x"], trace["y"]]), np.concatenate(EDGES), **EXACT)
    assert [ring[name] for name in ("x0", "x1", "y0", "y1")] == pytest.approx([0.25, 0.35, 0.45, 0.55], rel=1e-9, abs=0)


def test_page_opens_at_the_cell_of_the_part_next_to_the_middle() -> None:
    """On a grid of 12 x 9 cells, and where the middle is outside the part, or there is no part."""
    cell, outside, empty = drawn(shown(plate()), """
        const opened = page.cell;
        run.part.fill(0);
        const nothing = run.middleCell();
        [[6, 0], [8, 7], [2, 4], [6, 8]].forEach(([i, j]) => { run.part[j * run.nx + i] = 1; });
        run.part[1 * run.nx + 5] = 1;
        return [opened, run.middleCell(), nothing];
    """)  # fmt: skip
    assert MASK[6, 4]
    assert (cell, outside, empty) == ({"i": 6, "j": 4}, {"i": 5, "j": 1}, {"i": 6, "j": 4})


def test_cuts_are_the_row_and_the_column_of_the_cell() -> None:
    found = drawn(shown(plate()), """
        const cuts = [];
        for (page.along of ["x", "y"]) {
          await show(2, 3, 5);
          cuts.push([find("section").data, find("section").layout.title.text, find("section").layout.shapes[0].x0]);
        }
        return cuts;
    """)  # fmt: skip
    cuts: Any = (("y = 0.50 mm", 12, np.s_[:, 5], 0.3), ("x = 0.30 mm", 9, np.s_[3, :], 0.5))
    for (data, title, at), (place, count, line, here) in zip(found, cuts, strict=True):
        assert (title, at) == (f"Cut at {place}", pytest.approx(here, rel=1e-9, abs=0.0))
        earlier = np.array(data[0]["y"], float).reshape(2, -1)  # each layer ends in a gap
        np.testing.assert_allclose(earlier[:, :-1], [0.0 * UM[line], UM[line] / 2], **HALF)
        for trace, values in zip(data[1:], (TARGET * 1e6, UM, ERROR), strict=True):
            np.testing.assert_allclose(trace["x"], np.arange(count) * 0.1, **EXACT)
            np.testing.assert_allclose(np.array(trace["y"], float), values[line], **HALF)


def test_solid_has_a_plate_for_each_cell_and_coarser_ones_for_many() -> None:
    body, tops, heights, errors = drawn(shown(plate()), """
        await show(2, 3, 5);
        const wide = [run.heights(2), run.errors(2)].map((values) => coarser(run, values, 2, 6, 5));
        return [...find("solid").data, ...wide];
    """)  # fmt: skip
    corners = np.array([body[axis] for axis in "xyz"]).reshape(3, 9, 12, 4).swapaxes(1, 2)
    np.testing.assert_allclose(corners[:2].mean(axis=-1), np.indices((12, 9)) * 0.1, **EXACT)
    np.testing.assert_allclose(np.ptp(corners, axis=-1)[:, 0, 0], [0.1, 0.1, 0.0], **EXACT)
    np.testing.assert_allclose(corners[2, ..., 0], UM, **HALF)
    assert len(tops["intensity"]) == len(tops["i"]) == 2 * MASK.sum()
    for found, values in ((heights, UM), (errors, ERROR)):
        np.testing.assert_allclose(np.array(found, float).reshape(5, 6).T, means(values), **HALF)


def test_read_out_says_height_error_and_ink_of_the_cell() -> None:
    cells = [(0, 1), (3, 4), (3, 1), (3, 5)]
    code = "return more.map(([i, j]) => { Object.assign(page, { layer: 1, cell: { i, j } }); return readout(run); });"
    found = drawn(shown(plate()), code, cells)
    assert [text.rsplit("; ", 1)[1] for text in found] == ["no droplet.", "no droplet.", "ink A.", "ink B."]
    assert [", outside the part;" in text for text in found] == [True, False, False, False]
    height = round(UM[3, 5] / 2, 2)
    begin = f"Cell (3, 5) at x 0.300 mm, y 0.500 mm, layer 1: height {height:.2f} µm, target 20.00 µm"
    assert found[3] == f"{begin}: {20.0 - height:.2f} µm too low; ink B."
    (one,) = drawn(shown(plate(mismatch=None)), code, cells[2:3])
    assert one.endswith("; a droplet.")
    (block,) = drawn(shown(plate(), block=2), code, [(5, 4)])
    assert block.startswith("Cell (10…, 8…) at x 1.050 mm, y 0.800 mm, layer 1: height 0.00 µm, outside the part")
    assert block.endswith("; 0 % of the cells with a droplet.")


def test_click_on_a_map_of_finer_cells_chooses_the_block_of_the_layers() -> None:
    """The pictures of the final errors show the last layer; a click on another run shows that run."""
    code = """
        await show(0, 1, 1);
        find("finals").children[1].click(0.3, 0.5);
        const seen = [page.run, page.layer, page.cell, find("layer-number").textContent, find("layer").max];
        page.layer = 1;
        find("error").click(1.05, 0.8);
        return [...seen, page.run, page.layer, page.cell];
    """
    found = drawn(shown(plate(), plate("open"), block=2), code)
    assert found == [1, 2, {"i": 1, "j": 2}, "2 of 2", 2, 1, 1, {"i": 5, "j": 4}]


@pytest.mark.parametrize(("layer", "expected"), [(1, 2), (0, 0)])
def test_open_page_takes_what_it_lacks_and_follows_the_print_while_it_shows_the_last_layer(
    layer: int, expected: int
) -> None:
    """Layer 1 was scanned since the page got it, and layer 2 was printed."""
    begun, whole = Result(plate().dataset.isel(layer=slice(2)), plate().run), plate()
    scanned = whole.dataset["height"][1].values + 1e-6
    whole.dataset["height"][1] = scanned
    code = """
        page.layer = more.layer;
        await take(more.later);
        return [page.layer, page.runs[0] === run, find("layer-number").textContent, document.body.dataset.layers,
          [0, 1, 2].map((layer) => run.heights(layer)), run.jetted.length];
    """
    later = shown(whole, known=[2])
    *found, heights, jetted = drawn(shown(begun), code, {"later": later, "layer": layer})
    assert (found, jetted) == ([expected, True, f"{expected} of 2", "3"], 3)
    for values, stored in zip(heights, (0.0 * HEIGHT, scanned, HEIGHT), strict=True):
        np.testing.assert_allclose(np.reshape(values, (9, 12)).T, stored * 1e6, **HALF)


def test_requests_during_a_drawing_end_in_one_more() -> None:
    code = """
        let count = 0, end;
        const drawing = new Map([[find("solid"), (ended) => { count += 1; end = ended; }]]);
        Plotly.react = (place) => new Promise(drawing.get(place) ?? ((ended) => ended()));
        const rest = () => new Promise(setImmediate), first = redraw();
        redraw(); redraw(); redraw();
        const during = count;
        end(); await rest(); end(); await first;
        const after = count, again = redraw();
        end(); await again;
        return [during, after, count];
    """
    assert drawn(shown(plate()), code) == [1, 2, 3]


def test_problem_of_the_server_is_shown_until_it_is_gone() -> None:
    code = """
        const states = [];
        const answers = [{ json: async () => ({ problem: "run.json cannot be read" }) }, null, { status: 204 }];
        globalThis.fetch = async () => answers.shift() ?? Promise.reject(new Error("refused"));
        for (let look = 0; look < 3; look++) {
          await follow();
          states.push(find("state").textContent);
        }
        return states;
    """
    assert drawn(shown(plate()), code) == [
        "run.json cannot be read",
        "The page could not be updated: no connection to inkloop watch. It is tried again.",
        "The print ended at `layers_max` of the scenario: 2 layers.",
    ]


def test_page_draws_a_layer_of_more_cells_than_a_call_takes_arguments() -> None:
    cells, flat = np.zeros((401, 390)), ("x", "y")
    dataset = xr.Dataset(
        {
            "height": (("layer", *flat), np.stack([cells, cells + 9e-6])),
            "target_height": (flat, cells + 20e-6),
            "mask": (flat, np.ones_like(cells, np.bool_)),
            "mean_error": ("layer", [20e-6, 11e-6]),
            "std": ("layer", [0.0, 0.0]),
        },
        {"layer": np.arange(2), "x": np.arange(401) * 1e-4, "y": np.arange(390) * 1e-4},
        plate().dataset.attrs,
    )
    code = (
        'find("error").click(30.0, 0.7); return [find("surface").layout.coloraxis.cmax, find("readout").textContent];'
    )
    top, text = drawn(shown(Result(dataset, plate().run)), code)
    assert top == pytest.approx(20.0, rel=1e-6, abs=0.0)
    assert text == (
        "Cell (300, 7) at x 30.000 mm, y 0.700 mm, layer 1: height 9.00 µm, target 20.00 µm: 11.00 µm too low; "
        "no droplet."
    )

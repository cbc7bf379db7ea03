"""Choices of a user on the page and the values shown: cells, layers, inks, and the scale of the errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop.report.page.maps import LayerMaps, final_errors
from support.page_scripts import drawn, needs_node

pytestmark = [needs_node, pytest.mark.system]

SHAPE, PITCH = (6, 4), 1e-4
MASK = np.ones(SHAPE, np.bool_)
MASK[0] = False
PATTERN = np.zeros((3, *SHAPE), np.int32)
PATTERN[1:, 1:, :2], PATTERN[1:, 1:, 3] = 1, 2


def printed() -> xr.Dataset:
    """Two inks in layers of 5 um on a part of 8 um, whose first row of cells lies outside the part."""
    height = np.arange(3)[:, None, None] * np.where(MASK, 5e-6, 0.0)
    maps = {"height": (("layer", "x", "y"), height), "pattern": (("layer", "x", "y"), PATTERN)}
    flat = {"target_height": (("x", "y"), np.where(MASK, 8e-6, 0.0)), "mask": (("x", "y"), MASK)}
    places = {"layer": np.arange(3), "x": np.arange(6) * PITCH, "y": np.arange(4) * PITCH}
    return xr.Dataset(maps | flat, places, {"pitch": PITCH})


def described(block: int = 1, layers: int = 3) -> dict[str, Any]:
    """The first layers of the run as the page gets them."""
    dataset = printed().isel(layer=slice(layers))
    maps = LayerMaps(dataset, block)
    more = {"layers": maps.packed(), "final": final_errors(dataset, 1e6), "inks": 2}
    return {"name": "run", **maps.described(dataset), **more}


def test_cell_says_which_ink_fell_and_whether_it_is_of_the_part() -> None:
    cells = [(0, 1), (1, 0), (1, 2), (1, 3)]
    code = "run.target[1] = 7; return given.cells.map(([i, j]) => readout(run, 2, { i, j }));"
    found = drawn(described() | {"cells": cells}, code)
    assert [text.rsplit("; ", 1)[1] for text in found] == ["no droplet.", "ink A.", "no droplet.", "ink B."]
    assert [", outside the part;" in text for text in found] == [True, False, False, False]
    assert all("2.00 µm too high" in text for text in found[1:])
    (blocks,) = drawn(described(block=2) | {"cells": [(1, 1)]}, code)
    assert blocks.startswith("Cell (2…, 2…) at x 0.250 mm, y 0.250 mm, layer 2: height 10.00 µm, target 8.00 µm")
    assert blocks.endswith("; 50 % of the cells with a droplet.")


def test_droplets_are_shown_by_ink_or_as_a_share_of_their_block() -> None:
    code = """return given.numbers.map((inks) => {
        run.inks = inks;
        const look = dropletChart(run, 2, { i: 1, j: 1 }).data[0];
        return [look.colorbar.ticktext, look.colorbar.tickvals, look.zmin, look.zmax, look.colorscale.map(([at]) => at),
          look.z, look.colorbar.title.text];
    });"""
    two, one = drawn(described() | {"numbers": [2, 1]}, code)
    assert two[:4] == [["none", "ink A", "ink B"], [0, 1, 2], -0.5, 2.5]
    assert one[:4] == [["none", "droplet"], [0, 1], -0.5, 1.5]
    assert two[4] == pytest.approx([0, 1 / 3, 1 / 3, 2 / 3, 2 / 3, 1], rel=1e-12, abs=0.0)
    assert two[5] == PATTERN[2].T.tolist()
    jetted = (PATTERN[2] > 0).reshape(3, 2, 2, 2).mean(axis=(1, 3)) * 100.0
    for shares in drawn(described(block=2) | {"numbers": [2, 1]}, code):
        assert (shares[2], shares[3], shares[6]) == (0, 100, "cells with a droplet [%]")
        np.testing.assert_allclose(shares[5], jetted.T, rtol=0.0, atol=0.5)


def test_scales_are_those_of_the_whole_run_from_the_ground_up() -> None:
    code = """
        Object.assign(page, { runs: [run], layer: 1, scale: new ErrorScale([run]) });
        await showLayer();
        const top = find("surface").data[0].zmax, half = quantile(Float64Array.of(3, NaN, 1, NaN, 2, NaN, NaN), 0.5);
        run.target.fill(8);
        run.steps[2].fill(100);
        const ground = solidChart(run, 2, page.scale, false).layout.scene.zaxis.range[0];
        return [top, half, ground, plainText("<b> & </b>")];
    """
    assert drawn(described(), code) == [10, 2, 0, "&lt;b&gt; &amp; &lt;/b&gt;"]


def test_scale_of_errors_has_round_numbers_on_both_sides() -> None:
    code = """
        const scale = Object.assign(new ErrorScale([run]), { width: 0.7, limit: 30 });
        const { zmin, zmax, colorbar, colorscale } = scale.axis();
        return [zmin, zmax, colorbar.tickvals, colorbar.ticktext, colorscale[0], colorscale.at(-1)];
    """
    zmin, zmax, values, texts, first, last = drawn(described(), code)
    assert texts == ["-20", "-5", "-1", "0", "1", "5", "20"]
    np.testing.assert_allclose(values, np.arcsinh(np.array(texts, float) / 0.7), rtol=1e-12)
    np.testing.assert_allclose([zmin, zmax], np.arcsinh([-30 / 0.7, 30 / 0.7]), rtol=1e-12)
    assert (first, last) == ([0, "#67001f"], [1, "#053061"])


def test_click_on_a_map_of_finer_cells_chooses_the_block_of_the_layers() -> None:
    """The pictures of the final errors show the last layer; a click on another run shows that run."""
    code = """
        const other = new Run(given);
        await other.add(given);
        Object.assign(page, { runs: [other, run], layer: 0, scale: new ErrorScale([run]) });
        const place = find("a final picture");
        place.closest = (name) => (name === "#finals" ? {} : null);
        choosesCell(place, () => 1, () => 1);
        place.click({ points: [{ pointIndex: [3, 4] }] });
        const fine = page.cell;
        choosesCell(place, () => 1, () => 3);
        place.click({ points: [{ pointIndex: [1, 0] }] });
        return [page.run, page.layer, fine, page.cell, find("layer-number").textContent, find("layer").max];
    """
    assert drawn(described(block=2), code) == [1, 2, {"i": 2, "j": 1}, {"i": 0, "j": 1}, "2 of 2", 2]


@pytest.mark.parametrize(("layer", "expected"), [(1, 2), (0, 0)])
def test_open_page_follows_the_print_while_it_shows_the_last_layer(layer: int, expected: int) -> None:
    code = """
        showTexts = () => {};
        showFinals = async () => {};
        globalThis.Option = class {};
        document.body = { dataset: {} };
        find("run").replaceChildren = () => {};
        Object.assign(page, { runs: [run], layer: given.looks });
        await take({ runs: [given.later] });
        return [page.layer, page.runs[0] === run, find("layer-number").textContent, document.body.dataset.layers];
    """
    update = described() | {"layers": LayerMaps(printed(), 1).packed(2)}
    given = described(layers=2) | {"later": update, "looks": layer}
    assert drawn(given, code) == [expected, True, f"{expected} of 2", "3"]


def test_requests_during_a_drawing_end_in_one_more() -> None:
    code = """
        let count = 0, end;
        const update = newestOnly(() => { count += 1; return new Promise((ended) => { end = ended; }); });
        const first = update();
        update(); update(); update();
        const during = count;
        end();
        await new Promise((rest) => setTimeout(rest, 0));
        end();
        await first;
        const after = count, again = update();
        end();
        await again;
        return [during, after, count];
    """
    assert drawn(described(), code) == [1, 2, 3]


def test_problem_of_the_server_is_shown() -> None:
    code = """
        let events;
        globalThis.EventSource = class { constructor() { events = this; } };
        globalThis.fetch = async () => ({ json: async () => ({ problem: "run.json cannot be read" }) });
        follow();
        events.onmessage();
        await new Promise((rest) => setTimeout(rest, 0));
        const problem = find("state").textContent;
        globalThis.fetch = async () => { throw new Error("no answer"); };
        events.onmessage();
        await new Promise((rest) => setTimeout(rest, 0));
        return [problem, find("state").textContent];
    """
    expected = ["run.json cannot be read", "The page could not be updated: no answer"]
    assert drawn(described(), code) == expected

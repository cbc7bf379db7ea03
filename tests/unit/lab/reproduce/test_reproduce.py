"""Published and computed figures side by side, and the basis of the reproductions."""

from __future__ import annotations

import csv
import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from tools.figures import the_papers

from inkloop.cli import main
from inkloop.component import Job
from inkloop_lab.models.young_laplace_deposition import FineSurface
from inkloop_lab.reproduce import (
    PAPERS,
    hume_rosen,
    liquid_bodies,
    lu,
    prints,
    wu_chiu,
)
from inkloop_lab.reproduce.comparison import (
    Paper,
    Part,
    Row,
    Step,
    markdown,
    number,
    remarks,
    spreadsheet,
    terminal_table,
    with_scatter,
)
from inkloop_lab.reproduce.finite_elements import solve, triangles
from inkloop_lab.reproduce.hume_rosen import Liquid, time_scales
from support.long_proofs import rest_is_long


def ours(part: Part) -> dict[str, float]:
    return {f"{row.where}: {row.figure}": row.ours for row in part.rows}


@pytest.mark.parametrize(
    ("printed", "found", "within", "word"),
    [
        (5.0, 5.1, 0.2, "yes"),
        (5.0, 5.25, 0.25, "yes"),
        (5.0, 4.0, 0.2, "no, smaller"),
        (-5.0, -6.0, 0.2, "no, larger"),
        (None, 5.0, 0.2, "-"),
        (5.0, 9.0, None, "-"),
    ],
)
def test_a_figure_is_reproduced_within_what_is_asked(printed, found, within, word) -> None:
    assert Row("Table I", "height", "µm", printed, found, within).reproduced == word


def test_every_row_is_in_the_page_and_in_the_spreadsheet_and_every_remark_appears_once() -> None:
    rows = [
        Row("Table I", "height", "µm", 5.0, 5.1, 0.2, "a remark"),
        Row("Table I", "width", "µm", None, 2.0, None, "a remark", 0.31),
    ]
    assert remarks(rows) == ["Table I: a remark"]
    assert "| Table I | width | µm | - | 2.00 ± 0.31 | - |" in markdown("A paper", rows)
    table = list(csv.DictReader(io.StringIO(spreadsheet(rows))))
    assert [(line["printed"], line["ours"]) for line in table] == [("5.0", "5.1"), ("", "2.0")]


def test_figures_have_four_digits_and_scatter_two() -> None:
    assert [number(value) for value in (0.123456, 12.3456, 999.94, 12345.6, -1000.4, np.nan)] == [
        "0.1235", "12.35", "999.9", "12346", "-1000", "-",
    ]  # fmt: skip
    assert [with_scatter(12.3456, scatter) for scatter in (0.0123, 0.99, 1.0, 31.0, 0.0)] == [
        "12.346 ± 0.012", "12.35 ± 0.99", "12.3 ± 1.0", "12 ± 31", "12.346 ± 0.000",
    ]  # fmt: skip


def test_remarks_on_what_is_not_reproduced_come_first_with_all_their_places() -> None:
    rows = [
        Row("Fig. 2, left: a", "height", "µm", 5.0, 5.0, 0.2, "well"),
        Row("Fig. 3: b", "height", "µm", 5.0, 9.0, 0.2, "taller"),
        Row("Fig. 2, right", "height", "µm", 5.0, 5.0, 0.2, "taller"),
        Row("Fig. 4", "height", "µm", 5.0, 5.0, 0.2),
    ]
    assert remarks(rows) == ["Fig. 3, Fig. 2: taller", "Fig. 2: well"]


def test_table_names_a_place_once_and_draws_a_line_below_it() -> None:
    rows = [Row(place, "height", "µm", 5.0, 5.0, 0.2) for place in ("one", "one", "two")]
    shown = terminal_table("t", rows)
    assert [str(cell) for cell in shown.columns[0].cells] == ["one", "", "two"]
    assert [row.end_section for row in shown.rows] == [False, True, True]
    assert [column.justify for column in shown.columns] == ["left"] * 3 + ["right"] * 3 + ["left"]


def test_spreadsheet_has_numbers_in_full() -> None:
    lines = spreadsheet([Row("one", "height", "µm", 5.0, 1.23456789, None, "why", 0.001)]).splitlines()
    assert lines == [
        "where,figure,unit,printed,ours,within,reproduced,scatter,remark",
        "one,height,µm,5.0,1.23456789,,-,0.001,why",
    ]


def test_record_says_how_the_figures_were_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """And each step is found quickly or not, as was asked; pictures are of the step that has just ended."""
    asked: list[bool] = []

    def step(name: str) -> Step:
        def find(quick: bool) -> Part:
            asked.append(quick)
            return Part([Row(name, "n", "1", None, 1.0)], {f"picture of {name}": Figure()})

        return Step(name, find)

    monkeypatch.setattr("inkloop_lab.reproduce.wu_chiu.PAPER", Paper("wu-chiu", "Wu, Chiu", (step("a"), step("b"))))
    assert main(["reproduce", "wu-chiu", "--quick", "--out", str(tmp_path / "run")]) == 0
    record = json.loads((tmp_path / "run" / "reproduce.json").read_text())
    assert (record["paper"], record["steps"], record["quick"], list(record["seconds"])) == (
        "Wu, Chiu",
        ["a", "b"],
        True,
        ["a", "b"],
    )
    assert asked == [True, True]
    assert {path.stem for path in (tmp_path / "run").glob("picture*.png")} == {"picture of a", "picture of b"}
    assert main(["reproduce", "wu-chiu", "--no-pictures", "--out", str(tmp_path / "slow")]) == 0
    assert json.loads((tmp_path / "slow" / "reproduce.json").read_text())["quick"] is False


def test_time_scales_of_the_papers_ink_are_the_printed_ones() -> None:
    rows = [row for row in time_scales(True).rows if row.printed is not None and row.figure != "t_dep, at 8 kHz"]
    assert [row.reproduced for row in rows] == ["yes"] * 4
    assert Liquid().bond == pytest.approx(6.278e-4, rel=1e-3, abs=0.0)
    assert Liquid().ohnesorge == pytest.approx(0.3162, rel=1e-3, abs=0.0)


def test_liquids_outside_the_quasi_static_model_are_refused_with_the_reason() -> None:
    assert Liquid().objections() == []
    (slow,) = Liquid(interval=50e-6).objections()
    assert "80 us to come to rest, the next one comes after 50 us" in slow
    assert "Bond" in Liquid(diameter=1e-3, interval=1.0).objections()[0]
    assert "Ohnesorge" in Liquid(viscosity=0.1).objections()[0]
    with pytest.raises(ValueError, match=r"density is 0; .*speed is nan"):
        Liquid(density=0, speed=np.nan)


def test_edges_shrink_as_section_3c_states() -> None:
    assert {row.reproduced for row in lu.edges(True).rows if row.printed is not None} == {"yes"}


def test_dome_of_the_cuboid_is_the_recorded_one() -> None:
    found = ours(lu.edges(True))
    row = [found[f"Fig. 21, 22: cuboid, 4 layers: middle row, droplet {k}"] for k in range(1, 6)]
    assert row == pytest.approx(lu.DOME, abs=5e-4)
    assert found["Fig. 21, 22: cuboid, 4 layers: corner droplet"] == pytest.approx(24.536, abs=5e-4)


def test_a_pattern_that_made_a_surface_is_found_again() -> None:
    rows = lu.recovery(True).rows
    assert [row.ours for row in rows] == [10.0, 10.0]
    assert [row.reproduced for row in rows] == ["yes", "-"]  # the paper prints a figure for its own search


def test_what_a_controller_commands_is_no_droplet_once_nothing_is_missing() -> None:
    job = Job(6, 6, 1e-4, np.full((6, 6), 5e-6), np.ones((6, 6), dtype=np.bool_))
    assert not lu.first_pattern("StochasticGreedy", job, {}, np.full((6, 6), 5e-6)).any()
    assert lu.first_pattern("StochasticGreedy", job, {}, np.full((6, 6), -50e-6)).all()


def test_a_layer_is_as_even_from_0_58_to_0_66_as_at_the_papers_spacing() -> None:
    best, least, largest = lu.spacing(False).rows[:3]
    assert lu.CHOSEN not in lu.SWEEP
    assert (least.ours, largest.ours) == (0.58, 0.66)
    assert least.ours <= best.ours <= largest.ours


NOT_PRINTED_OR_PUT_IN = {
    "III-A: spacing gamma": "",
    "Fig. 21, 22: cuboid, 4 layers": "",
    "(18)": "",
    "(20), profiles made with (20)": "",
    "Theory": "",
    "Table 2, nonlinear, 2nd order, 2.5 µm, outline of 22 points": "",
    "Table 1": "t_dep, at 8 kHz",
    "IV-C: recoverability": "LayerMpc, one layer ahead",
}
"""Places of which no row, or one row, may count as reproduced: no paper prints the figure, or it was an input."""


def recorded_rows() -> list[list[str]]:
    return [row for paper in the_papers.PAPERS for row in the_papers.rows_of(paper)]


def test_what_no_paper_prints_and_what_was_put_in_is_not_called_reproduced() -> None:
    rows = recorded_rows()
    assert {row[0] for row in rows} >= NOT_PRINTED_OR_PUT_IN.keys()
    for where, figure, _, printed, _, within, reproduced in rows:
        assert (within == "-") <= (reproduced == "-"), (where, figure)
        if where in NOT_PRINTED_OR_PUT_IN and NOT_PRINTED_OR_PUT_IN[where] in ("", figure):
            assert reproduced == "-", (where, figure)
        assert reproduced == "-" or printed != "-", (where, figure)


def test_the_record_holds_the_figures_of_the_present_code() -> None:
    """Of the steps that take moments; `tools/figures/the_papers.py` writes all of them."""
    steps = (lu.edges, lu.spacing, wu_chiu.printed_sample, time_scales)
    record = recorded_rows()
    for row in (row for step in steps for row in step(False).rows):
        assert list(row.cells) in record


def test_size_of_a_mean_error_is_not_called_mean_error() -> None:
    figures = [figure for where, figure, *_ in recorded_rows() if where.startswith(("Fig. 11", "Fig. 12"))]
    assert sum(figure.endswith(": absolute mean error") for figure in figures) == 6
    assert not any(figure.endswith(": mean error") for figure in figures)


def test_width_of_a_block_is_where_it_is_half_as_high() -> None:
    block = np.zeros((12, 12))
    block[2:-2, 2:-2] = 22.8
    assert prints.width(block, 0) == pytest.approx(8.0, rel=1e-9, abs=0.0)
    block[1, :] = 11.4  # half of the next cell on one side
    assert prints.width(block, 0) == pytest.approx(8.5, rel=1e-9, abs=0.0)
    assert prints.width(block, 1) == pytest.approx(8.0, rel=1e-9, abs=0.0)


def test_cap_is_the_exact_one_in_the_middle_and_at_the_rim() -> None:
    assert liquid_bodies.exact(np.array([0.0, 35.1999])) == pytest.approx([14.5803, 0.0], abs=1e-4)


@pytest.mark.parametrize("form", ["linear", "nonlinear"])
def test_square_has_its_shape_on_a_coarse_grid(form) -> None:
    """Of three layers; the full square is a long test."""
    surface, _ = liquid_bodies.printed(form, 4, layers=3)
    assert liquid_bodies.outside(surface) < 0.02
    assert liquid_bodies.ridge(surface) > float(surface.height[7:22, 7:22].mean()) * 1e6
    assert liquid_bodies.corner(surface) < float(surface.height[7:22, 7:22].mean()) * 1e6
    assert liquid_bodies.wall(liquid_bodies.end_wall(surface), surface.spacing * 1e6)[0] > 60.0


def cross(one, other):
    """Areas of the parallelograms of vectors (n, 2)."""
    return one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]


def circle(points: int, radius: float = 35.1999):
    turns = np.arange(points) * 2 * np.pi / points
    return radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)


def test_triangles_fill_the_outline() -> None:
    outline = circle(48)
    nodes, found = triangles(outline, 6.0)
    one, two, three = (nodes[found[:, k]] for k in range(3))
    area = 0.5 * np.abs(cross(two - one, three - one)).sum()
    ahead = np.roll(outline, -1, axis=0)
    assert area == pytest.approx(0.5 * np.abs(np.sum(cross(outline, ahead))), rel=1e-9, abs=0.0)
    assert len(nodes) > 2 * len(outline)
    reverse, _ = triangles(outline[::-1], 6.0)  # whichever way round it goes
    np.testing.assert_allclose(sorted(map(tuple, reverse.round(6))), sorted(map(tuple, nodes.round(6))), atol=1e-6)


@pytest.mark.parametrize("form", ["linear", "nonlinear"])
def test_elements_hold_the_volume_over_the_ground_and_stay_at_its_edge(form) -> None:
    pytest.importorskip("skfem")

    def slope(places):
        return 0.1 * places[:, 0] + 3.0

    found = solve(circle(48), 20e3, 6.0, form=form, order=1, ground=slope)
    rim = np.hypot(*found.places.T) > 35.0 * np.cos(np.pi / 48)
    assert found.height[rim] == pytest.approx(slope(found.places[rim]), abs=1e-9)
    _, triangle = triangles(circle(48), 6.0)
    corner = found.places[triangle]
    area = 0.5 * np.abs(cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]))
    held = area @ (found.height - slope(found.places))[triangle].mean(axis=1)
    assert held == pytest.approx(20e3, rel=1e-9, abs=0.0)


@pytest.mark.parametrize("order", [1, 2])
def test_elements_converge_to_the_cap(order) -> None:
    pytest.importorskip("skfem")
    errors = [liquid_bodies._by_triangles("nonlinear", order, size)[1] for size in (10.0, 5.0, 2.5)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < {1: 0.03, 2: 0.003}[order]


def test_without_scikit_fem_the_rest_is_reproduced_and_the_gap_is_reported(monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "skfem", None)
    rows = liquid_bodies.single_droplet(True).rows
    (gap,) = [row for row in rows if row.where == "Table 2"]
    assert "scikit-fem" in gap.figure
    assert gap.cells[4] == "-"
    assert {row.reproduced for row in rows if row.where == "Validation" and row.printed is not None} == {"yes"}


def test_group_of_wu_and_chiu_gives_the_ratios_of_its_own_equation_17() -> None:
    found = ours(wu_chiu.printed_sample(True))
    ratios = [found[f"(17) on (18), (19): {name}"] for name in ("mv_plus", "mv_minus", "ma_plus", "ma_minus")]
    assert ratios == pytest.approx([0.0081, -0.0187, 0.0, -0.0636], abs=5e-5)
    assert found["(19): cap of 0.6 pitches, default: rms error"] < 0.18
    assert found["(19): cap of 1.5 pitches, the text: rms error"] > 2.0


def test_error_of_a_pattern_is_in_percent_with_its_scatter() -> None:
    estimate: Any = SimpleNamespace(rms={"1": (0.0625, 0.0125), "2 on the sides": (0.5, 0.25)})
    row = wu_chiu._error_row("Table I", "1", 5.1, estimate)
    assert (row.printed, row.ours, row.scatter, row.unit) == (5.1, 6.25, 1.25, "%")


def test_profile_holds_the_pixels_that_stand_above_the_noise() -> None:
    """Of 16 x 16 pixels of a cell a quarter is 3 um high; noise of 0.04 um elsewhere is no ink."""
    surface = wu_chiu.liquid().start(np.zeros((wu_chiu.SIDE, wu_chiu.SIDE)))
    surface.over_grid[16:24, 32:40] = 3e-6
    height, area = wu_chiu._measured(surface, np.random.default_rng(0))
    expected = np.zeros((wu_chiu.SIDE, wu_chiu.SIDE))
    expected[1, 2] = 0.25
    np.testing.assert_array_equal(area, expected)
    np.testing.assert_allclose(height, 3e-6 * expected, rtol=0.01)


def test_resampling_gives_back_the_coefficients_that_made_the_profiles() -> None:
    rows = [row for row in wu_chiu.resampled(True).rows if row.where == "(20), profiles made with (20)"]
    assert [row.ours for row in rows] == pytest.approx([0.0067, -0.0201, 0.0, -0.0634], rel=0.05, abs=1e-6)
    assert [row.reproduced for row in rows] == ["-"] * 4


@pytest.mark.system
@pytest.mark.parametrize("paper", rest_is_long(["wu-chiu", "hume-rosen"], 1))
def test_command_leaves_tables_and_pictures(paper, tmp_path, capsys) -> None:
    assert main(["reproduce", paper, "--quick", "--out", str(tmp_path / "run")]) == 0
    assert "printed" in capsys.readouterr().out
    left = {path.name for path in (tmp_path / "run").iterdir()}
    assert {"table.md", "table.csv", "table.txt", "reproduce.json"} < left
    assert any(name.endswith(".png") for name in left)
    assert main(["reproduce", paper, "--quick", "--out", str(tmp_path / "run")]) == 1


def test_command_keeps_what_is_finished_when_it_is_interrupted(tmp_path, monkeypatch, capsys) -> None:
    def interrupt(quick: bool) -> Part:
        raise KeyboardInterrupt

    paper = __import__("inkloop_lab.reproduce.wu_chiu", fromlist=["PAPER"]).PAPER
    steps = (paper.steps[0], type(paper.steps[1])("stopped", interrupt))
    monkeypatch.setattr("inkloop_lab.reproduce.wu_chiu.PAPER", type(paper)(paper.name, paper.reference, steps))
    assert main(["reproduce", "wu-chiu", "--out", str(tmp_path / "run")]) == 130
    assert "(17) on (18), (19)" in (tmp_path / "run/table.md").read_text()
    assert "interrupted" in capsys.readouterr().out


@pytest.mark.long
@pytest.mark.parametrize("paper", PAPERS)
def test_whole_reproduction_ends_well(paper, tmp_path) -> None:
    assert main(["reproduce", paper, "--out", str(tmp_path / "run")]) == 0
    table = {
        f"{line['where']}: {line['figure']}": line
        for line in csv.DictReader(io.StringIO((tmp_path / "run/table.csv").read_text()))
    }
    if paper == "lu":
        assert table["Fig. 11: cylinder, 20 %: open loop: absolute mean error"]["reproduced"] == "yes"
        assert table["Fig. 12: cylinder, 40 %: open loop: absolute mean error"]["reproduced"] == "yes"
        assert float(table["Fig. 11: cylinder, 20 %: LayerMpc: standard deviation"]["ours"]) < 0.6
        assert float(table["Fig. 13, 14: pipe junction: LayerMpc: geometry mismatch"]["ours"]) < 4.0


@pytest.mark.long
@pytest.mark.parametrize("per_pitch", [8, 16])
def test_square_has_the_recorded_shape_and_keeps_it_on_a_finer_grid(per_pitch) -> None:
    surface, _ = liquid_bodies.printed("nonlinear", per_pitch)
    (end_width, end_angle), (side_width, side_angle) = (
        liquid_bodies.wall(profile, surface.spacing * 1e6)
        for profile in (liquid_bodies.end_wall(surface), liquid_bodies.side_wall(surface))
    )
    middle = float(surface.height[7:22, 7:22].mean()) * 1e6
    heights = liquid_bodies.ridge(surface), liquid_bodies.corner(surface)
    found = [middle, end_width, end_angle, side_width, side_angle, *heights]
    assert found == pytest.approx([185.3, 154.6, 44.1, 34.3, 78.1, 200.5, 80.0], rel=0.05, abs=0.0)
    assert liquid_bodies.outside(surface) < 0.005


def drawn_square(n: int) -> tuple[FineSurface, np.ndarray]:
    """The square of 25 x 25 sites in a margin of two, n points to a site, of arbitrary heights [m]."""
    fine = np.random.default_rng(n).random((29 * n, 29 * n)) * 1e-6
    surface = FineSurface(fine.reshape(29, n, 29, n).mean((1, 3)), np.pad(fine, 3), 1e-6, 3)
    return surface, fine * 1e6


@pytest.mark.parametrize("n", [3, 4])
def test_figures_of_the_square_are_read_at_their_places(n: int) -> None:
    """Lines run along x; an even number of points has its site between two of them each way."""
    surface, fine = drawn_square(n)
    np.testing.assert_allclose(liquid_bodies.end_wall(surface), [row[7 * n : 22 * n].mean() for row in fine])
    np.testing.assert_allclose(liquid_bodies.side_wall(surface), [row[7 * n : 22 * n].mean() for row in fine.T])
    inside = sum(fine[i, j] for i in range(2 * n, 27 * n) for j in range(2 * n, 27 * n))
    assert liquid_bodies.outside(surface) == pytest.approx(1.0 - inside / fine.sum(), rel=1e-9, abs=0.0)
    around = (0,) if n % 2 else (-1, 0)
    sites = [k * n + n // 2 for k in range(29)]
    corners = [fine[sites[i] + di, sites[j] + dj] for i in (2, 26) for j in (2, 26) for di in around for dj in around]
    assert liquid_bodies.corner(surface) == pytest.approx(np.mean(corners), rel=1e-9, abs=0.0)
    lines = [np.mean([fine[sites[i], sites[j]] for i in range(7, 22)]) for j in range(29)]
    assert liquid_bodies.ridge(surface) == pytest.approx(max(lines), rel=1e-9, abs=0.0)


def test_wall_is_from_a_tenth_to_nine_tenths_of_the_height() -> None:
    profile = np.concatenate([np.linspace(0.0, 20.0, 11), np.full(19, 20.0), np.linspace(20.0, 0.0, 5)])
    assert liquid_bodies.wall(profile, 5.0) == pytest.approx(
        (40.0, np.degrees(np.arctan(16.0 / 40.0))), rel=1e-9, abs=0.0
    )


def test_line_at_the_edge_keeps_its_volume_and_runs_over_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Droplets of 30 pl that stay on their cells: of a line along the edge none lies beyond it, across it some."""
    n, spacing = 8, 42.3e-6 / 8

    class Model:
        def __init__(self, form: str, cells_per_pitch: int) -> None:
            assert cells_per_pitch == n

        def start(self, height: Any) -> FineSurface:
            return FineSurface(height, np.zeros(tuple(n * side + 4 for side in height.shape)), spacing, 2)

        def layer(self, surface: FineSurface, pattern: Any, number: int = 1) -> FineSurface:
            fine = surface.fine.copy()
            fine[2:-2, 2:-2] += np.kron(pattern, np.ones((n, n))) * 30e-15 / 42.3e-6**2
            return FineSurface(surface.height + pattern, fine, spacing, 2)

    shown = {}
    monkeypatch.setattr(hume_rosen, "YoungLaplaceDeposition", Model)
    monkeypatch.setattr("inkloop_lab.reproduce.pictures.lines_on_a_step", lambda surfaces: shown.update(surfaces))
    found = ours(hume_rosen.line_on_a_step(True))
    beyond = {"along the edge": 0.0, "across the edge": 100.0 * sum(j >= hume_rosen.EDGE for j in range(3, 8)) / 5}
    assert 0.0 < beyond["across the edge"] < 100.0
    for name, share in beyond.items():
        for form in ("nonlinear", "linear"):
            where = f"Fig. 3 to 5, {name}, {form}"
            assert found[f"{where}: volume kept, of five droplets"] == pytest.approx(100.0, rel=1e-9, abs=0.0)
            assert found[f"{where}: volume beyond the edge"] == pytest.approx(share, rel=1e-9, abs=1e-9)
            height = 30e-15 / 42.3e-6**2 * 1e6
            assert found[f"{where}: thickest place of the line"] == pytest.approx(height, rel=1e-9, abs=0.0)
            assert found[f"{where}: highest point over the plate"] == pytest.approx(2.0 * height, rel=1e-9, abs=0.0)
            below, after = shown[f"{name}, {form}"]
            line = np.argwhere(after.height - below.height > 0.5)
            assert (np.ptp(line, axis=0) == ([4, 0] if name == "along the edge" else [0, 4])).all()


def test_holding_back_and_coming_to_rest_have_their_limits() -> None:
    assert Liquid(viscosity=0.0316).objections() == []  # an Ohnesorge number of 0.9993
    assert "Ohnesorge number 1" in Liquid(viscosity=0.0317).objections()[0]
    assert Liquid(interval=81e-6).objections() == []
    assert len(Liquid(interval=79e-6).objections()) == 1
    assert Liquid(diameter=504e-6, interval=1.0).objections() == []  # a Bond number of 0.0997
    assert "Bond number 0.1;" in Liquid(diameter=506e-6, interval=1.0).objections()[0]

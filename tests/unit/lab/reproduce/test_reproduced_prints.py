"""Rows of whole prints: means over the seeds of each controller, beside what the paper prints; prints are doubles.

Every print has two cells off the part that are far from all others.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from inkloop_lab.reproduce import prints
from inkloop_lab.reproduce.comparison import Row
from inkloop_lab.reproduce.prints import by_controller, cuboids, cylinder, mean_and_scatter, pipes, width

LABELS = ["LayerMpc", "paper's search", "open loop"]


class Print:
    """A result of these figures [um]; the surface is a block of the given height with a step of 2 um along y."""

    def __init__(self, seed: int, mean_error: float, std: float, side: int = 4, height: float = 20.0) -> None:
        surface, mask = np.zeros((side + 4, side + 4)), np.zeros((side + 4, side + 4), np.int8)
        mask[2:-2, 2:-2] = 1
        surface[2:-2, 2:-2] = (height + seed) * 1e-6
        surface[2:-2, -3] += 2e-6
        surface[0, 0] = 1e-3
        self.figures = {"mean_error": mean_error * 1e-6, "std": std * 1e-6, "mismatch": 0.0125, "mae": 3e-6}
        self.dataset = SimpleNamespace(mask=xr.DataArray(mask), seed=seed)
        self.final_height, self.stop_reason = xr.DataArray(surface), "done"

    def metrics(self) -> dict[str, float]:
        return self.figures


@pytest.fixture
def printed(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """Scenarios in the order of their prints; seeds 1 and 2 err to both sides."""
    seen: list[Any] = []

    def print_part(scenario: Any) -> Print:
        tables = scenario.tables
        seen.append(tables)
        seed, base = tables.seed, {"LayerMpc": 1.0, "paper's search": 10.0, "open loop": 40.0}[tables.label]
        return Print(seed, (base + seed) * (-1.0) ** seed, 2.0 * base + 3.0 * seed, tables.grid.nx - 4)

    monkeypatch.setattr(prints, "print_part", print_part)
    for module, name in ((prints, "cross_section"), (prints, "surfaces"), (prints, "solids")):
        monkeypatch.setattr(module, name, lambda shown: {label: each.seed for label, each in shown.items()})
    monkeypatch.setattr("inkloop.report.layer_curves.cross_section", lambda shown: list(shown))
    return seen


def rows_by_figure(rows: Any) -> dict[str, Row]:
    return {row.figure: row for row in rows}


def test_every_controller_prints_with_every_seed(printed: list[Any]) -> None:
    runs = by_controller("cylinder", [5, 3], {"components.printer.variation": 0.125})
    assert list(runs) == LABELS
    assert [[each.dataset.seed for each in results] for results in runs.values()] == [[5, 3]] * 3
    assert [(tables.label, tables.seed) for tables in printed] == [(label, seed) for seed in (5, 3) for label in LABELS]
    assert {tables.components["printer"].options["variation"] for tables in printed} == {0.125}
    assert list(by_controller("cylinder", [1], without=["paper's search"])) == ["LayerMpc", "open loop"]


def test_interrupted_print_ends_the_step(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(prints, "print_part", lambda scenario: SimpleNamespace(stop_reason="interrupted"))
    with pytest.raises(KeyboardInterrupt):
        by_controller("cylinder", [1])


def test_scatter_is_the_standard_deviation_over_prints() -> None:
    assert mean_and_scatter([1.0, 3.0]) == (2.0, pytest.approx(2.0**0.5, rel=1e-12, abs=0.0))
    assert mean_and_scatter([1.5]) == (1.5, None)


@pytest.mark.parametrize(
    ("variation", "open_loop", "search"), [(0.2, (44.1, 15.0), (0.7, 4.1)), (0.4, (84.7, 16.6), (1.9, 4.5))]
)
def test_mean_errors_of_cylinders_are_sizes_beside_those_of_the_paper(
    variation: float, open_loop: Any, search: Any, printed: list[Any]
) -> None:
    part = cylinder(True, variation=variation)
    assert len(printed) == 6  # two seeds
    rows = rows_by_figure(part.rows)
    for label, base, of_paper, within in (
        ("open loop", 40.0, open_loop, 1.0),
        ("paper's search", 10.0, search, None),
        ("LayerMpc", 1.0, (None, None), None),
    ):
        bias, std = rows[f"{label}: absolute mean error"], rows[f"{label}: standard deviation"]
        assert (bias.ours, std.ours) == pytest.approx((base + 1.5, 2.0 * base + 4.5), rel=1e-9, abs=0.0)
        assert (bias.scatter, std.scatter) == pytest.approx((0.5**0.5, 3.0 * 0.5**0.5), rel=1e-9, abs=0.0)
        assert (bias.printed, std.printed) == of_paper
        assert (bias.within, std.within) == (within, within)
    assert rows["LayerMpc: absolute mean error"].remark == prints.SIGNS
    assert rows["paper's search: standard deviation"].remark == prints.OTHER_PLANT
    assert rows["open loop: standard deviation"].remark == prints.NO_SPREAD
    assert rows["open loop: absolute mean error"].remark == ""
    name = f"cylinder-{100 * variation:.0f}"
    assert part.pictures == {name: dict.fromkeys(LABELS, 1), f"{name}-surfaces": dict.fromkeys(LABELS, 1)}


def test_cuboids_have_the_heights_of_the_part_and_their_growth_each_way(printed: list[Any]) -> None:
    part = cuboids(True)
    sizes = [
        (tables.grid.nx, tables.grid.ny, tables.components["printer"].options["passes"]) for tables in printed[::6]
    ]
    assert sizes == [(12, 12, 1), (12, 12, 4), (13, 13, 1)]
    assert printed[0].part.size_x_um == printed[0].part.size_y_um == pytest.approx(8 * 263.256, rel=1e-12, abs=0.0)
    places = list(dict.fromkeys(row.where for row in part.rows))
    assert places == ["Table II: 8 x 8, 1 pass", "Table II: 8 x 8, 4 passes", "Table II: 9 x 9, 1 pass"]
    of_paper = rows_by_figure(row for row in part.rows if row.where == places[1])
    for figure, ours, scatter in (
        ("average height", 21.5 + 2.0 / 8.0, 0.5**0.5),
        ("standard deviation", 2.0 * 7**0.5 / 8.0, 0.0),
    ):
        for label, column in (("open loop", 18.5), ("paper's search", 22.3), ("LayerMpc", None)):
            row = of_paper[f"{label}: {figure}"]
            assert row.ours == pytest.approx(ours, rel=1e-9, abs=0.0)
            assert row.scatter == pytest.approx(scatter, rel=1e-9, abs=1e-9)
            if figure == "average height":
                assert row.printed == column
    growth = {name: of_paper[f"paper's search: growth in {name}"] for name in "xy"}
    assert [(row.printed, row.within, row.remark) for row in growth.values()] == [(10.0, 3.0, prints.NO_GROWTH)] * 2
    assert of_paper["open loop: growth in x"].printed is None
    block = printed_heights(8, 1)
    expected = [100.0 * (width(block, axis) / 8 - 1.0) for axis in (0, 1)]
    other = [100.0 * (width(printed_heights(8, 2), axis) / 8 - 1.0) for axis in (0, 1)]
    assert [row.ours for row in growth.values()] == pytest.approx(np.mean([expected, other], axis=0), rel=1e-9, abs=0.0)
    assert growth["x"].ours != growth["y"].ours
    elsewhere = [row for row in part.rows if row.where != places[1]]
    assert all(row.printed is None for row in elsewhere)
    assert part.pictures == {"cuboid": LABELS}


def printed_heights(side: int, seed: int) -> Any:
    return Print(seed, 0.0, 0.0, side).final_height.values * 1e6


def test_width_is_a_mean_over_inner_lines_and_none_where_nothing_stands() -> None:
    """Of 12 lines the inner four count: two of 7 cells, one of 9, one that is too low."""
    lines = np.zeros((12, 14))
    lines[:4] = lines[-4:] = 100.0  # outer lines
    lines[4, 3:10] = lines[5, 3:10] = lines[6, 3:12] = 22.8
    lines[7, 3:10] = 11.0
    assert width(lines.T, 0) == pytest.approx((7.0 + 7.0 + 9.0 + 0.0) / 4, rel=1e-9, abs=0.0)
    assert width(lines, 1) == pytest.approx(23.0 / 4, rel=1e-9, abs=0.0)


def test_pipes_have_their_mismatch_in_percent_and_leave_out_the_slow_search(printed: list[Any]) -> None:
    part = pipes(True)
    rows = rows_by_figure(part.rows)
    labels = ["LayerMpc", "open loop"]
    assert list(rows) == [f"{label}: {figure}" for label in labels for figure in (
        "geometry mismatch", "mean absolute error of the top",
    )]  # fmt: skip
    assert [row.ours for row in rows.values()] == pytest.approx([1.25, 3.0] * 2, rel=1e-9, abs=0.0)
    assert part.pictures == {"pipe-junction": dict.fromkeys(labels, 1)}
    assert len(rows_by_figure(pipes(False).rows)) == 6

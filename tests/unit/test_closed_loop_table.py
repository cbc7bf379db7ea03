"""The benchmark of the closed loop: what must be better is marked, and a print that ran away unnoticed is counted."""

from __future__ import annotations

from typing import Any

import pytest
from benchmarks import closed_loop
from benchmarks.prints import OPEN_LOOP, OURS, SHOWN, Figure, Metrics
from tools.figures import closed_loop as closed_loop_page

SHIFTED = closed_loop.SHIFTED[2]


def metrics(**of_one: float) -> Metrics:
    """Prints that are all alike [m], but for one of a shifted sensor."""
    found = dict.fromkeys(closed_loop_page.COLUMNS.values(), 0.0)
    prints: Metrics = {
        (case.name, name): [dict(found), dict(found)] for case in closed_loop.CASES for name in case.planners
    }
    prints[closed_loop.IN_REGISTER.name, OPEN_LOOP] = [{**found, "highest": 8e-6}] * 2
    prints[SHIFTED.name, OURS][1] = {**found, **of_one}
    return prints


@pytest.mark.parametrize(
    ("of_one", "count"),
    [
        ({"highest": 8.1e-6}, 1),
        ({"highest": 8.1e-6, "untrusted": 3.0}, 0),
        ({"highest": 7.9e-6}, 0),
    ],
    ids=["above", "above with a warning", "below"],
)
def test_prints_that_end_above_the_open_loop_without_a_warning_are_counted(of_one: Any, count: int) -> None:
    *_, (silent,) = closed_loop.rows(metrics(**of_one)).values()
    assert silent.now == count
    assert silent.reached == ("MISSED" if count else "aim")


def test_figures_that_must_be_better_are_bold_on_the_page() -> None:
    prints = metrics(highest=6e-6, mae=0.9e-6)
    written = closed_loop_page.texts_of(prints)["closed loop"].replace("0.000", "0")
    assert "| R10, shift 0.1 cells in x and y | 0.45 / 0.5 | 0 | | **6** / 5 |" in written


def test_record_holds_every_print_of_the_table() -> None:
    prints = {(case.name, planner) for case in closed_loop.CASES for planner in case.planners}
    found = closed_loop_page.kept(closed_loop_page.RUNS)
    assert {name: len(each) for name, each in found.items()} == dict.fromkeys(prints, closed_loop_page.SEEDS)


def test_no_print_of_the_record_runs_away_without_a_warning() -> None:
    *_, (silent,) = closed_loop.rows(closed_loop_page.kept(closed_loop_page.RUNS)).values()
    assert silent.now == 0


def test_highest_cell_of_the_worst_print_counts() -> None:
    assert Figure("highest", (1.0, 3.0), must=2.0, aim=1.0, worst=True).reached == "MISSED: 1.50 x"
    assert Figure("mean", (1.0, 3.0), must=2.0, aim=1.0).reached == "must"


def test_means_of_both_signs_are_refused_and_mean_errors_are_distances() -> None:
    with pytest.raises(ValueError, match=r"highest: \(-2.0, 3.0\) have both signs, which cancel in their mean"):
        print(Figure("highest", (-2.0, 3.0)).now)
    assert Figure("highest", (-2.0, -3.0)).now == -2.5
    case, found = closed_loop.CYLINDERS[0], metrics()
    found[case.name, OURS] = [{**found[case.name, OURS][0], "mean_error": error} for error in (-2e-6, 3e-6)]
    assert closed_loop.rows(found)[case.name][0].now == pytest.approx(2.5, rel=1e-9, abs=0.0)
    assert next(closed_loop_page.readme_rows(found))[1] == "2.50"


def test_prints_are_kept_as_they_were(tmp_path: Any) -> None:
    prints = metrics(highest=6e-6, shift_error=0.0123, layers=29.0)
    closed_loop_page.keep(prints, tmp_path / "prints.csv")
    kept = closed_loop_page.kept(tmp_path / "prints.csv")
    assert kept.keys() == prints.keys()
    for name, found in prints.items():
        for one, other in zip(found, kept[name], strict=True):
            assert one == {metric: pytest.approx(other[metric], rel=1e-9, abs=0.0) for metric in one}
    assert set(closed_loop_page.COLUMNS.values()) <= SHOWN.keys()

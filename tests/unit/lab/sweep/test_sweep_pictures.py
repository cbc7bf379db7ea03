"""Pictures and tables of a study: every mark, bar and label stands for the points that it names."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib.colors
import numpy as np
import pytest
import xarray as xr

from inkloop.report.plot import COLOURS
from inkloop_lab.sweep.dataset import STATUSES
from inkloop_lab.sweep.pictures import pictures
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.summary import errors_of, points, short_names, table_of_indices, table_of_points, winner
from support.sweeps import study

ALPHA, FINISH, HORIZON = (f"components.controller.{name}" for name in ("alpha", "finish", "horizon"))
VARIED = f'[vary]\n"{ALPHA}" = [0.5, 0.8, 1.0]\n"{FINISH}" = ["even", "fast"]\n"{HORIZON}" = [1, 2]\n'
NONE = xr.Dataset()


@pytest.fixture(scope="module")
def three_keys(tmp_path_factory: pytest.TempPathFactory) -> Study:
    return study(tmp_path_factory.mktemp("varied"), VARIED)


def point(std: float | None, layers: float = 4.0, error: float = 0.3, **keys: Any) -> dict[str, Any]:
    """A point as `points` gives them; keys by the end of their name."""
    setting = {f"components.controller.{name}": value for name, value in keys.items()}
    return {"keys": setting, "std_um": std, "std_um_standard_error": error, "layers": layers, "prints": 2, "failed": 0}


def varied() -> list[dict[str, Any]]:
    """3 x 2 x 2 points: alpha changes the roughness most, then finish; the horizon hardly."""
    found = []
    for alpha, finish, horizon in itertools.product((0.5, 0.8, 1.0), ("even", "fast"), (1, 2)):
        std = 10 * alpha + {"even": 0.0, "fast": 2.0}[finish] + 0.2 * horizon
        found.append(point(std, alpha=alpha, finish=finish, horizon=horizon))
    return found


@pytest.mark.parametrize(
    ("stds", "error", "sentence"),
    [
        ([4.0, 3.0, 9.0], 0.3, "smallest std: alpha 0.8: 3.00 ± 0.30 µm"),
        (
            [3.5, 3.0, 9.0],
            0.3,
            "smallest std: alpha 0.8: 3.00 ± 0.30 µm; 1 of 2 others are not worse beyond the scatter",
        ),
        ([None, 3.0, 9.0], np.nan, "smallest std: alpha 0.8: 3.00 µm"),
        ([None, 3.0, None], 0.3, ""),
    ],
)
def test_winner_is_the_point_with_the_smallest_metric(
    stds: list[float | None], error: float, sentence: str, tmp_path: Path
) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8, 1.0]\n')
    found = winner(
        own, [point(std, error=error, alpha=alpha) for std, alpha in zip(stds, (0.5, 0.8, 1.0), strict=True)]
    )
    assert found.startswith(sentence)
    assert bool(found) == bool(sentence)
    assert ("others" in found) == ("others" in sentence)


def drawn(line: Any) -> Any:
    """x and y of the points of a line, (2, K)."""
    return np.array(line.get_data(), np.float64)


def panels(figure: Any) -> dict[str, Any]:
    """Label of x -> axes that are seen."""
    return {axes.get_xlabel(): axes for axes in figure.axes if axes.get_visible()}


def texts(labels: Sequence[Any]) -> list[str]:
    return [label.get_text() for label in labels]


def test_main_effects_are_means_over_all_other_keys(three_keys: Study) -> None:
    found = pictures(three_keys, varied(), NONE)
    assert sorted(found) == ["front", "heat-map", "main-effects"]
    effects = panels(found["main-effects"])
    assert list(effects) == ["alpha", "finish", "horizon"]
    for name, names, values in (
        ("alpha", ["0.5", "0.8", "1.0"], [6.3, 9.3, 11.3]),
        ("finish", ["even", "fast"], [23 / 3 + 0.3, 29 / 3 + 0.3]),
        ("horizon", ["1", "2"], [26 / 3 + 0.2, 26 / 3 + 0.4]),
    ):
        axes = effects[name]
        x, y = axes.containers[0].lines[0].get_data()
        np.testing.assert_allclose(np.array(y, float), values, rtol=1e-9)
        assert texts(axes.get_xticklabels()) == names
        np.testing.assert_array_equal(axes.get_xticks(), np.array(x, float))
        low, high = np.array([end for end, _ in _bars(axes)]), np.array([end for _, end in _bars(axes)])
        each = 12 / len(values)  # errors of 0.3 of so many points
        np.testing.assert_allclose(high - low, 2 * 0.3 / np.sqrt(each), rtol=1e-9)
    assert effects["alpha"].get_ylabel() == "std [µm]"


def test_error_of_a_mean_is_none_where_one_of_its_points_has_none(tmp_path: Path) -> None:
    text = f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n"{FINISH}" = ["even", "fast"]\n'
    text += "".join(
        f'"components.{key}" = [1, 2]\n' for key in ("controller.horizon", "printer.passes", "printer.seed")
    )
    found = [point(1.0, error=0.3, alpha=0.5), point(2.0, error=np.nan, alpha=0.5), point(3.0, error=0.4, alpha=0.8)]
    for number, each in enumerate(found):
        each["keys"] |= {FINISH: ("even", "fast", "even")[number], HORIZON: 1 + number % 2}
        each["keys"] |= {f"components.printer.{key}": number for key in ("passes", "seed")}
    figure = pictures(study(tmp_path, text), found, NONE)["main-effects"]
    effects = panels(figure)
    assert [high - low for low, high in _bars(effects["alpha"])] == pytest.approx([0.0, 0.8], rel=1e-9, abs=0.0)
    assert len(effects) == 5
    rows = {axes.get_subplotspec().rowspan.start for axes in effects.values()}
    assert rows == {0, 1}  # four in a row
    assert figure.get_figheight() == pytest.approx(2 * 1.9 + 0.3, rel=1e-9, abs=0.0)


def _bars(axes: Any) -> list[tuple[float, float]]:
    """Lower and upper ends of the error bars."""
    segments = axes.containers[0].lines[2][0].get_segments()
    return [(float(segment[0][1]), float(segment[1][1])) for segment in segments]


def test_sampled_key_shows_its_points_and_the_means_of_eight_groups(tmp_path: Path) -> None:
    own = study(tmp_path, f'[sample]\nmethod = "random"\npoints = 40\n"{ALPHA}" = {{ uniform = [0.2, 1.0] }}\n')
    values = np.linspace(0.2, 1.0, 40)
    found = pictures(own, [point(value**2, alpha=value) for value in values[::-1].tolist()], NONE)
    assert sorted(found) == ["front", "main-effects"]  # no key is in [vary]
    axes = panels(found["main-effects"])["alpha"]
    assert sorted(axes.lines[0].get_xdata()) == pytest.approx(list(values), rel=1e-12, abs=0.0)
    x, y = axes.containers[0].lines[0].get_data()
    groups = values.reshape(8, 5)
    np.testing.assert_allclose(np.array(x, float), groups.mean(axis=1), rtol=1e-9)
    np.testing.assert_allclose(np.array(y, float), np.square(groups).mean(axis=1), rtol=1e-9)
    spread = np.square(groups).std(axis=1, ddof=1) / np.sqrt(5)
    np.testing.assert_allclose([(high - low) / 2 for low, high in _bars(axes)], spread, rtol=1e-9)


def test_cells_of_the_heat_map_are_the_means_under_their_labels(three_keys: Study) -> None:
    figure = pictures(three_keys, varied()[:-2], NONE)["heat-map"]  # alpha 1.0, "fast" is missing
    axes, bar = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), bar.get_ylabel()) == ("alpha", "finish", "std [µm]")
    across, down = texts(axes.get_xticklabels()), texts(axes.get_yticklabels())
    seen = {(across[int(t.get_position()[0])], down[int(t.get_position()[1])]): t.get_text() for t in axes.texts}
    expected = {(a, f): f"{10 * float(a) + 2 * (f == 'fast') + 0.3:.3g}" for a in across for f in down}
    assert seen == {**expected, ("1.0", "fast"): "-"}
    image: Any = axes.get_images()[0]
    assert not axes.yaxis_inverted()
    np.testing.assert_allclose(image.get_array()[0], [5.3, 8.3, 10.3], rtol=1e-9)
    for text in axes.texts:
        if text.get_text() != "-":  # readable: black on light, white on dark
            grey = np.dot(image.to_rgba(float(text.get_text()))[:3], [0.3, 0.6, 0.1])
            assert text.get_color() == ("black" if grey > 0.5 else "white")


def test_front_joins_the_points_that_no_other_beats(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\n')
    at = {0.1: (3, 5.0), 0.2: (4, 5.0), 0.3: (5, 2.0), 0.4: (6, 3.0), 0.5: (8, 1.0), 0.6: (3, 6.0)}
    found = [point(std, layers, alpha=alpha) for alpha, (layers, std) in at.items()]
    axes: Any = pictures(own, found, NONE)["front"].axes[0]
    every, front = axes.lines
    assert (every.get_label(), front.get_label()) == ("points", "Pareto front")
    np.testing.assert_array_equal(drawn(every).T, list(at.values()))
    np.testing.assert_array_equal(drawn(front).T, [at[0.1], at[0.3], at[0.5]])
    assert texts(axes.texts) == ["alpha 0.1", "alpha 0.3", "alpha 0.5"]
    assert [text.xy for text in axes.texts] == [
        pytest.approx(at[alpha], rel=1e-12, abs=0.0) for alpha in (0.1, 0.3, 0.5)
    ]
    assert [text.get_horizontalalignment() for text in axes.texts] == ["left", "left", "right"]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("layers", "std [µm]")
    assert texts(axes.get_legend().get_texts()) == ["points", "Pareto front"]


def with_indices() -> xr.Dataset:
    """Indices of two metrics and keys: for `std` 0.7 and 0.1 alone, 0.8 and 0.2 with interactions."""
    values = {"first_order": [[0.3, 0.4], [0.7, 0.1]], "total_order": [[0.5, 0.6], [0.8, 0.2]]}
    made = {}
    for name, value in values.items():
        for end, shift in (("", 0.0), ("_low", -0.05), ("_high", 0.15)):
            made[f"{name}{end}"] = (("metric", "key"), np.array(value) + shift)
    return xr.Dataset(made, {"metric": ["mae", "std"], "key": [ALPHA, HORIZON]})


SAMPLED = f"""[sample]
method = "sobol-indices"
points = 8
"{ALPHA}" = {{ uniform = [0.2, 1.0] }}
"{HORIZON}" = {{ integers = [1, 3] }}
"""


def test_indices_are_those_of_the_metric_and_of_the_key_beside_them(tmp_path: Path) -> None:
    own, found = study(tmp_path, SAMPLED), with_indices()
    axes: Any = pictures(own, [point(1.0, alpha=0.5, horizon=1)], found)["sensitivities"].axes[0]
    assert axes.get_xlabel() == "share of the variance of std"
    assert texts(axes.get_yticklabels()) == ["alpha", "horizon"]
    assert axes.yaxis_inverted()
    bars = [each for each in axes.containers if hasattr(each, "patches")]
    assert [bar.get_label() for bar in bars] == ["alone", "with interactions"] == texts(axes.get_legend().get_texts())
    for bar, widths in zip(bars, ([0.7, 0.1], [0.8, 0.2]), strict=True):
        assert [patch.get_width() for patch in bar] == pytest.approx(widths, rel=1e-12, abs=0.0)
        assert [round(patch.get_y() + patch.get_height() / 2) for patch in bar] == [0, 1]
    assert bars[0][0].get_y() + bars[0][0].get_height() <= bars[1][0].get_y() + 0.0201
    ends = [segment[:, 0] for each in axes.collections for segment in each.get_segments()]
    np.testing.assert_allclose(ends, [(v - 0.05, v + 0.15) for v in (0.7, 0.1, 0.8, 0.2)], rtol=1e-9)

    table = table_of_indices(own, found)
    rows = list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True))
    assert rows == [
        ("alpha", "0.70", "0.65 to 0.85", "0.80", "0.75 to 0.95"),
        ("horizon", "0.10", "0.05 to 0.25", "0.20", "0.15 to 0.35"),
    ]
    assert [" ".join(str(column.header).split()) for column in table.columns] == [
        "key", "alone", "interval", "with interactions", "interval",
    ]  # fmt: skip
    assert table.note is not None
    assert "of the variance of std (Sobol' indices), with 95 % intervals" in table.note


@pytest.mark.parametrize(("aim", "best"), [("minimise", [3.0, 2.0, 2.0, 2.0, 1.0]), ("maximise", [3.0, 3, 3, 4, 4])])
def test_search_shows_each_trial_and_the_best_so_far(aim: str, best: Sequence[float], tmp_path: Path) -> None:
    text = f'[optimise]\n{aim} = "std_um"\ntrials = 5\n[vary]\n"{ALPHA}" = [0.5, 0.8]\n'
    trials = [3.0, 2.0, float("nan"), 4.0, 1.0]
    figure = pictures(study(tmp_path, text), [point(1.0, alpha=0.5)], NONE, trials)["search"]
    (axes,) = figure.axes
    every, so_far = axes.lines
    np.testing.assert_array_equal(every.get_ydata(), trials)
    np.testing.assert_array_equal(so_far.get_ydata(), best)
    assert (every.get_label(), so_far.get_label()) == ("trial", "best so far")
    assert so_far.get_drawstyle() == "steps-post"  # holds from its trial on
    assert matplotlib.colors.same_color(so_far.get_color(), COLOURS[0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("trial", "std_um")


def test_points_that_failed_are_in_no_picture(three_keys: Study) -> None:
    assert pictures(three_keys, [point(None, alpha=0.5, finish="even", horizon=1)], NONE) == {}


def sweep_of_two_seeds(own: Study) -> xr.Dataset:
    """Alpha 0.5: 2 and 4 um; alpha 0.8: -1 um and a print that failed; alpha 1.0: nothing printed."""
    std = np.array([[2e-6, 4e-6], [-1e-6, np.nan], [np.nan, np.nan]])
    layers = np.array([[5.0, 8.0], [7.0, np.nan], [np.nan, np.nan]])
    status = np.array([[1, 2], [1, STATUSES.index("failed")], [0, 0]])
    error = np.array([["", ""], ["", "gave up"], ["", ""]], object)
    dims = (ALPHA, "seed")
    values = {"std": std, "layers": layers, "status": status, "error": error}
    return xr.Dataset({name: (dims, value) for name, value in values.items()}, {ALPHA: [0.5, 0.8, 1.0]})


def test_table_has_means_with_their_errors_in_units_of_people(tmp_path: Path) -> None:
    own = study(tmp_path, f'title = "Weights"\n[vary]\n"{ALPHA}" = [0.5, 0.8, 1.0]\n[seeds]\ncount = 2\n')
    sweep = sweep_of_two_seeds(own)
    found = points(own, sweep)
    assert [each["keys"] for each in found] == [{ALPHA: 0.5}, {ALPHA: 0.8}, {ALPHA: 1.0}]
    assert [(each["prints"], each["failed"]) for each in found] == [(2, 0), (2, 1), (0, 0)]
    assert [each["std_um"] for each in found] == [3.0, -1.0, None]
    assert found[0]["std_um_standard_error"] == pytest.approx(1.0, rel=1e-12, abs=0.0)
    assert np.isnan(found[1]["std_um_standard_error"])
    assert found[0]["layers"] == 6.5
    assert errors_of(sweep) == [("gave up", 1)]
    table = table_of_points(own, found)
    assert [" ".join(str(column.header).split()) for column in table.columns] == [
        "point",
        "std [µm]",
        "layers",
        "prints",
    ]
    rows = list(zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True))
    assert rows == [
        ("alpha 0.5", "3.00 ± 1.00", "6.5", "2"),
        ("alpha 0.8", "-1.00", "7.0", "2 (1 failed)"),
        ("alpha 1", "-", "-", "0"),
    ]
    assert (table.heading, table.note) == ("Weights", "mean over the seeds, ± its standard error")


def test_table_of_many_points_shows_those_nearest_to_zero(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8, 1.0]\n')
    found = [point(std, alpha=std) for std in (3.0, -1.0, 2.0, -4.0)]
    for each in found:
        each["layers_standard_error"] = 0.0
    table = table_of_points(own, [*found, point(None, alpha=9.0)], rows_max=3)
    assert [str(cell) for cell in table.columns[0].cells] == ["alpha -1", "alpha 2", "alpha 3"]
    assert table.note == "mean over the seeds, ± its standard error; the 3 points of 5 with the smallest std"


def test_winner_is_of_whole_points_by_size_and_others_are_alike_within_two_errors(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8, 1.0]\n')
    near = [
        point(std, error=error, alpha=alpha)
        for std, error, alpha in ((3.0, 0.3, 0.5), (-3.9, 0.4, 0.8), (4.1, 0.4, 1.0))
    ]
    assert winner(own, near).startswith("smallest std: alpha 0.5: 3.00 ± 0.30 µm; 1 of 2 others")  # 2 x 0.5 away
    near[0]["failed"] = 1
    assert winner(own, near).startswith("smallest std: alpha 0.8: -3.90 ± 0.40 µm; 1 of 1 others")
    plain = study(tmp_path, "")
    assert winner(plain, [point(1.0), point(2.0)]).startswith("smallest std: as it stands: 1.00")


def test_stopped_and_faulty_prints_are_no_failed_ones(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5]\n[seeds]\ncount = 3\n')
    codes = [STATUSES.index(name) for name in ("failed", "fault", "stopped")]
    sweep = xr.Dataset({"status": ((ALPHA, "seed"), [codes])}, {ALPHA: [0.5]})
    assert [(each["prints"], each["failed"]) for each in points(own, sweep)] == [(3, 1)]


def test_mean_errors_are_compared_by_their_size(tmp_path: Path) -> None:
    own = study(tmp_path, f'metric = "mean_error"\n[vary]\n"{ALPHA}" = [0.5]\n[seeds]\ncount = 2\n')
    values = {"mean_error": ((ALPHA, "seed"), [[-2e-6, 4e-6]]), "status": ((ALPHA, "seed"), [[1, 1]])}
    (found,) = points(own, xr.Dataset(values, {ALPHA: [0.5]}))
    assert found["mean_error_um"] == pytest.approx(3.0, rel=1e-12, abs=0.0)
    assert str(table_of_points(own, [found]).columns[1].header).split() == ["|mean_error|", "[µm]"]
    found["std_um"], found["layers"] = 1.0, 3.0
    axes = pictures(own, [{**found, "keys": {ALPHA: alpha}} for alpha in (0.5, 0.8)], NONE)["main-effects"].axes[0]
    assert axes.get_ylabel() == "|mean error| [µm]"


def test_indices_stand_beside_the_value_of_the_other_key_and_are_its_mean_in_the_picture(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{FINISH}" = ["even", "fast"]\n{SAMPLED}')
    shift = xr.DataArray([0.0, 0.1], {FINISH: ["even", "fast"]}, (FINISH,))
    both = (with_indices() + shift).transpose(FINISH, "metric", "key")
    names = [str(cell) for cell in table_of_indices(own, both).columns[0].cells]
    assert names == ["finish even: alpha", "finish even: horizon", "finish fast: alpha", "finish fast: horizon"]
    found = pictures(own, [point(1.0, alpha=0.5, horizon=1, finish="even")], both)["sensitivities"].axes[0]
    bars = [each for each in found.containers if hasattr(each, "patches")]
    assert [patch.get_width() for patch in bars[0]] == pytest.approx([0.75, 0.15], rel=1e-9, abs=0.0)


def test_few_numbers_are_places_in_their_order_and_truths_are_names(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [1.0, 0.5, 0.25, 0.75, 0.1, 0.2, 0.3, 0.4]\n')
    found = [point(alpha, alpha=alpha) for alpha in (1.0, 0.5, 0.25, 0.75, 0.1, 0.2, 0.3, 0.4)]
    axes = panels(pictures(own, found, NONE)["main-effects"])["alpha"]
    assert texts(axes.get_xticklabels()) == ["0.1", "0.2", "0.25", "0.3", "0.4", "0.5", "0.75", "1.0"]
    sweeps = study(tmp_path, '[vary]\n"components.controller.sweeps" = [30, 9, 100]\n')
    found = [point(float(count), sweeps=count) for count in (30, 9, 100)]
    axes = panels(pictures(sweeps, found, NONE)["main-effects"])["sweeps"]
    assert texts(axes.get_xticklabels()) == ["9", "30", "100"]
    truths = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5]\n"components.controller.register_scans" = [true, false]\n')
    found = [point(float(on), alpha=0.5, register_scans=on) for on in (True, False)]
    axes = panels(pictures(truths, found, NONE)["main-effects"])["register_scans"]
    assert texts(axes.get_xticklabels()) == ["True", "False"]
    assert "front" in pictures(truths, found, NONE)
    assert "front" not in pictures(truths, [point(1.0, alpha=0.5, register_scans=on) for on in (True, False)], NONE)


def test_labels_of_the_map_are_told_from_all_keys_of_the_study(tmp_path: Path) -> None:
    printer = "components.printer.seed"
    own = study(tmp_path, f'[vary]\n"{printer}" = [1, 2]\n"components.profiler.seed" = [1]\n"{ALPHA}" = [0.5, 0.8]\n')
    found = [
        {**point(alpha + seed), "keys": {printer: seed, "components.profiler.seed": 1, ALPHA: alpha}}
        for seed in (1, 2)
        for alpha in (0.5, 0.8)
    ]
    axes = pictures(own, found, NONE)["heat-map"].axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("printer.seed", "alpha")


def test_front_of_many_points_names_some_and_of_many_keys_none(tmp_path: Path) -> None:
    alphas = [0.05 * n for n in range(1, 14)]
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = {alphas}\n')
    found = [point(20.0 - n, 3.0 + n, alpha=alpha) for n, alpha in enumerate(alphas)]
    axes: Any = pictures(own, found, NONE)["front"].axes[0]
    assert [text.xy[0] for text in axes.texts] == [3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]  # every second of 13
    three = f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n"{FINISH}" = ["even", "fast"]\n"{HORIZON}" = [1, 2]\n'
    for extra, named in (("", True), ('"components.printer.seed" = [1, 2]\n', False)):
        keys = {"seed": "components.printer.seed"} if extra else {}
        found = [
            point(3.0 - n, 3.0 + n, alpha=0.5 + 0.3 * n, finish=("even", "fast")[n], horizon=1 + n) for n in (0, 1)
        ]
        for n, each in enumerate(found):
            each["keys"] |= dict.fromkeys(keys.values(), 1 + n)
        axes = pictures(study(tmp_path, three + extra), found, NONE)["front"].axes[0]
        assert bool(axes.texts) == named


def test_short_name_is_the_end_that_no_other_key_has() -> None:
    keys = ("components.a.alpha", "components.b.alpha", "part.height_um", "grid.nx", "nx")
    assert short_names(keys[:4]) == dict(zip(keys, ("a.alpha", "b.alpha", "height_um", "nx"), strict=False))
    assert short_names(("grid.nx", "fine_nx")) == {"grid.nx": "nx", "fine_nx": "fine_nx"}

"""A search by its rules: what a trial is worth, whose records count, what another search is; sensitivities by key."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
import xarray as xr

from inkloop.errors import ResultError
from inkloop.report.terminal import Terminal
from inkloop_lab.sweep import sensitivity
from inkloop_lab.sweep.plan import OptimisePlan
from inkloop_lab.sweep.report import report
from inkloop_lab.sweep.sensitivity import indices
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Record, Task, failed
from support.sweeps import ISHIGAMI, Shuffled, ishigami, record, study, swept

ALPHA, FINISH, HORIZON = (f"components.controller.{name}" for name in ("alpha", "finish", "horizon"))
VARIATION = "components.printer.variation"
SEARCH = f"""
[optimise]
minimise = "layers"
trials = 5
at_once = 2
seed = 3
[vary]
"{FINISH}" = ["even", "fast"]
[sample]
"{ALPHA}" = {{ loguniform = [0.0001, 1.0] }}
"{HORIZON}" = {{ integers = [1, 2] }}
[seeds]
count = 3
first = 40
"""


def search_of(own: Study) -> OptimisePlan:
    pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    assert own.tables.optimise is not None
    return OptimisePlan(own, own.tables.optimise)


def ended(plan: OptimisePlan, worth: Any) -> list[list[Task]]:
    """The batches of a search whose prints have so many layers."""
    batches, tasks = [], list(plan.begin())
    while tasks:
        batches.append(tasks)
        following = [plan.after(worth(task)) for task in tasks]
        assert not any(following[:-1])
        tasks = list(following[-1])
    return batches


def test_trials_are_planned_in_batches_with_the_same_seeds(tmp_path: Path) -> None:
    plan = search_of(study(tmp_path, SEARCH))
    assert (plan.total, plan.best) == (15, None)
    batches = ended(plan, lambda task: record(task, layers=1.0))
    assert [[task.key for task in batch[::3]] for batch in batches] == [[(0, 0), (1, 0)], [(2, 0), (3, 0)], [(4, 0)]]
    assert {tuple(task.seed for task in batch[:3]) for batch in batches} == {(40, 41, 42)}
    for task in (task for batch in batches for task in batch):
        assert task.overrides == plan.settings[task.point]
    assert plan.best == 0  # the first of several


def test_worth_of_a_trial_is_the_mean_of_its_prints_and_none_where_one_failed(tmp_path: Path) -> None:
    plan = search_of(study(tmp_path, SEARCH))

    def worth(task: Task) -> Record:
        if task.point == 3 and task.replicate == 1:
            return failed(task, "gave up")
        return record(task, layers=[7.0, 3.0, 5.0, 1.0, 4.0][task.point] + [0.0, 0.0, 6.0][task.replicate])

    ended(plan, worth)
    np.testing.assert_array_equal(plan.values, [9.0, 5.0, 7.0, np.nan, 6.0])
    assert plan.best == 1


def test_search_covers_all_that_it_may_choose_and_goes_by_its_seed(tmp_path: Path) -> None:
    text = SEARCH.replace("trials = 5", "trials = 40").replace("at_once = 2", "at_once = 40").replace("count = 3", "")
    found = [search_of(study(tmp_path, text.replace("seed = 3", f"seed = {seed}"))) for seed in (3, 4, 3)]
    for plan in found:
        list(plan.begin())
    settings, other, same = ([tuple(each.items()) for each in plan.settings] for plan in found)
    assert settings == same
    assert not set(settings) & set(other)
    chosen = [dict(each) for each in settings]
    assert {each[FINISH] for each in chosen} == {"even", "fast"}
    assert {each[HORIZON] for each in chosen} == {1, 2}
    alphas = np.array([each[ALPHA] for each in chosen])
    assert 1e-4 <= alphas.min() < 1e-3  # as many in each decade
    assert 5 < np.count_nonzero(alphas < 1e-2) < 35


def test_trials_that_are_no_longer_asked_for_are_left_out_of_the_file(tmp_path: Path) -> None:
    def worth(task: Task) -> Record:
        return record(task, layers=float(task.point))

    swept(study(tmp_path, SEARCH), tmp_path / "out", Shuffled(worth))
    few = study(tmp_path, SEARCH.replace("trials = 5", "trials = 2"))
    found, _, seen = swept(few, tmp_path / "out", Shuffled(worth))
    assert (found.sizes["trial"], len(seen)) == (2, 6)
    np.testing.assert_array_equal(found["layers"].values[:, 0], [0.0, 1.0])


@pytest.mark.parametrize(
    ("old", "new", "changed"),
    [
        ("at_once = 2", "at_once = 3", "optimise"),
        ("seed = 3", "seed = 4", "optimise"),
        ('minimise = "layers"', 'maximise = "layers"', "optimise"),
        ("count = 3", "count = 4", "optimise"),
        ("first = 40", "first = 41", "vary, sample or seeds.first"),
        ("integers = [1, 2]", "integers = [1, 3]", "vary, sample or seeds.first"),
        ("[vary]", "[keep]\nlayers = true\n[vary]", "keep"),
    ],
)
def test_other_search_is_refused_in_the_folder_and_what_changed_is_named(
    old: str, new: str, changed: str, tmp_path: Path
) -> None:
    def worth(task: Task) -> Record:
        return record(task, layers=1.0)

    swept(study(tmp_path, SEARCH), tmp_path / "out", Shuffled(worth, interrupted_after=1))
    with pytest.raises(ResultError, match=rf"changed since then: {changed}\. Take the change back"):
        swept(study(tmp_path, SEARCH.replace(old, new)), tmp_path / "out", Shuffled(worth))
    swept(study(tmp_path, f'title = "other"\n{SEARCH}'), tmp_path / "out", Shuffled(worth))


def test_resumed_search_asks_for_the_same_points(tmp_path: Path) -> None:
    text = SEARCH.replace('"layers"', '"std_um + 0.1 * layers"').replace("trials = 5\nat_once = 2", "trials = 16")
    text = text.replace("loguniform = [0.0001", "uniform = [0.2").replace("integers = [1, 2]", "integers = [1, 3]")

    def valley(task: Task) -> Record:
        alpha, horizon = task.overrides[ALPHA], task.overrides[HORIZON]
        return record(task, std=1e-6 * (alpha - 0.6) ** 2 + 1e-8 * task.seed, layers=float(abs(horizon - 2)))

    pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    own = study(tmp_path, text)
    whole, plan, _ = swept(own, tmp_path / "whole", Shuffled(valley, slots=1))
    for engine in (Shuffled(valley, 5, 1, interrupted_after=13), Shuffled(valley, 3, 2)):
        again, _, _ = swept(own, tmp_path / "parts", engine)
    xr.testing.assert_identical(whole, again)
    assert isinstance(plan, OptimisePlan)
    assert plan.best is not None
    assert len(np.unique(whole[ALPHA].values)) == 16
    assert plan.settings[plan.best][HORIZON] == 2
    assert abs(whole[ALPHA].values[plan.best] - 0.6) < 0.15


def reported(own: Study, worth: Any, folder: Path, left: int = -1) -> tuple[int, dict[str, Any], str]:
    """Failed prints, the figures and the text of a report of a study, interrupted after `left` prints."""
    found, plan, _ = swept(own, folder, Shuffled(worth, slots=1, interrupted_after=left))
    figures, shown = dict[str, Any](), io.StringIO()
    console = Terminal(shown)
    console.result = lambda **values: figures.update(values)
    return report(own, found, plan, folder, (), console, is_whole=False), figures, shown.getvalue()


def test_report_of_a_search_has_its_best_trial_and_what_failed(tmp_path: Path) -> None:
    def worth(task: Task) -> Record:
        if task.point < 2:
            return Record(task.point, task.replicate, "fault", {"layers": 2.0}) if task.point else failed(task, "a\nb")
        return record(task, layers=9.0 - task.point)

    own = study(tmp_path, SEARCH)
    failures, figures, _ = reported(own, worth, tmp_path / "out")
    assert (failures, figures["failed"], figures["prints"], figures["indices"]) == (6, 6, 15, None)
    assert figures["interrupted"] is True
    plan = search_of(own)
    ended(plan, worth)
    assert figures["best"] == {"trial": 1, "value": 2.0, "keys": plan.settings[1]}


def test_report_counts_the_prints_that_have_ended(tmp_path: Path) -> None:
    def plant(task: Task) -> Record:
        return failed(task, "gave up") if task.key == (0, 0) else record(task, std=1e-6, layers=2.0)

    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n[seeds]\ncount = 3\n')
    failures, figures, shown = reported(own, plant, tmp_path / "out", 4)
    assert (failures, figures["prints"], figures["failed"], figures["best"]) == (1, 4, 1, None)
    assert "1 print failed: gave up" in shown
    assert "4 of 6 prints of " in (tmp_path / "out" / "study.html").read_text(encoding="utf-8")
    sample = f'[sample]\nmethod = "sobol-indices"\npoints = 8\n"{ALPHA}" = {{ uniform = [0.2, 1.0] }}\n'
    assert reported(study(tmp_path, sample), plant, tmp_path / "none", 0)[0] == 0


def test_indices_of_ishigami_are_within_three_bootstrap_errors(tmp_path: Path) -> None:
    keys = (VARIATION, "components.profiler.noise_std_um", ALPHA)
    lines = "\n".join(f'"{key}" = {{ uniform = [0.0, 0.4] }}' for key in keys)
    own = study(tmp_path, f'[sample]\nmethod = "sobol-indices"\npoints = 512\n{lines}\n')

    def plant(task: Task) -> Record:
        return record(task, std=ishigami([math.pi * (task.overrides[key] / 0.2 - 1.0) for key in keys]))

    sweep, _, seen = swept(own, tmp_path / "out", Shuffled(plant, slots=8))
    assert len(seen) == 2560
    of_std = sweep.sel(metric="std")
    values = [of_std[name].sel(key=list(keys)).values for name in ("first_order", "total_order")]
    errors = [of_std[f"{name}_error"].values for name in ("first_order", "total_order")]
    assert np.all(np.abs(values - ISHIGAMI) <= 3.0 * np.array(errors))
    assert np.max(errors) < 0.09
    block, figures = sweep["block"].values, sweep["std"].values[:, 0]
    ab = np.stack([figures[block == f"AB {key}"] for key in keys])
    theirs = scipy.stats.sobol_indices(
        func={"f_A": figures[None, block == "A"], "f_B": figures[None, block == "B"], "f_AB": ab[:, None]}, n=512
    )
    np.testing.assert_allclose(values, [np.ravel(theirs.first_order), np.ravel(theirs.total_order)], rtol=1e-9)


def test_indices_leave_out_failed_prints_and_need_eight_points_and_a_variance() -> None:
    a, b, ab = np.random.default_rng(1).random((3, 64))
    assert np.isfinite(indices(a[:8], b[:8], ab[None, :8]).values).all()
    assert np.isnan(indices(a[:7], b[:7], ab[None, :7]).values).all()
    constant = indices(np.ones(64), np.ones(64), np.ones((2, 64)))
    assert np.isnan(constant.values).all()
    assert (constant.values.shape, constant.points) == ((2, 2), 64)
    a[5], b[9] = np.nan, np.nan
    kept = np.isfinite(a) & np.isfinite(b)
    found, expected = indices(a, b, ab[None]), indices(a[kept], b[kept], ab[None, kept])
    assert found.points == 62
    np.testing.assert_array_equal(found.values, expected.values)


def test_intervals_of_indices_are_those_of_95_per_cent() -> None:
    """The estimates of many points are nearly normal: 3.92 standard errors wide, about the value."""
    a, b = np.random.default_rng(4).random((2, 2, 400))
    figures = [2.0 * x + y for x, y in (a, b, (b[0], a[1]), (a[0], b[1]))]
    found = indices(figures[0], figures[1], np.stack(figures[2:]))
    np.testing.assert_allclose(found.values, [[0.8, 0.2]] * 2, atol=0.12)
    np.testing.assert_allclose((found.high - found.low) / found.error, 3.92, rtol=0.08)
    np.testing.assert_allclose((found.high + found.low) / 2, found.values, atol=0.02)


def test_sensitivities_stand_beside_the_value_of_the_other_key_that_they_are_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With "even" alpha alone counts, with "fast" the variation; intervals are drawn by the seed of the sample."""
    monkeypatch.setattr(sensitivity, "RESAMPLES", 8)
    text = f"""
[vary]
"{FINISH}" = ["even", "fast"]
[sample]
method = "sobol-indices"
points = 32
seed = 5
"{ALPHA}" = {{ uniform = [0.1, 1.0] }}
"{VARIATION}" = {{ uniform = [0.0, 0.4] }}
[seeds]
count = 2
"""

    def plant(task: Task) -> Record:
        if task.point == 3 and task.replicate:
            return failed(task, "gave up")
        return record(task, std=1e-6 * task.overrides[ALPHA if task.overrides[FINISH] == "even" else VARIATION])

    found, _, _ = swept(study(tmp_path, text), tmp_path / "out", Shuffled(plant, slots=8))
    for finish, expected in (("even", [1.0, 0.0]), ("fast", [0.0, 1.0])):
        of_std = found.sel({"metric": "std", FINISH: finish})
        for name in ("first_order", "total_order"):
            np.testing.assert_allclose(of_std[name].values, expected, atol=0.45)
        figures = of_std["std"].values.mean(axis=-1)  # none of a point of which a print failed
        a, b, *ab = (figures[found["block"].values == name] for name in ("A", "B", f"AB {ALPHA}", f"AB {VARIATION}"))
        own = indices(a, b, np.array(ab), 5)
        assert own.points == (31 if finish == "even" else 32)
        np.testing.assert_array_equal(of_std["total_order_low"], own.low[1])
        np.testing.assert_array_equal(of_std["first_order_high"], own.high[0])
        np.testing.assert_array_equal(of_std["first_order_error"], own.error[0])
    for end, words in (("low", "lower"), ("high", "upper")):
        text = found[f"total_order_{end}"].attrs["long_name"]
        assert text.startswith(f"{words} end of the 95% interval of the share")

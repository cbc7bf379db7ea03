"""A search by its rules: what a trial is worth, whose records count, what another search is; sensitivities by key."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from inkloop.errors import ResultError, ScenarioError
from inkloop.report.terminal import Terminal
from inkloop_lab.sweep import sensitivity
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.optimise import OptimisePlan
from inkloop_lab.sweep.report import report
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Record, Task, failed
from support.sweeps import SCENARIO, Shuffled, record, study, swept

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


def test_report_of_a_search_has_its_best_trial_and_what_failed(tmp_path: Path) -> None:
    def worth(task: Task) -> Record:
        if task.point < 2:
            return Record(task.point, task.replicate, "fault", {"layers": 2.0}) if task.point else failed(task, "a\nb")
        return record(task, layers=9.0 - task.point)

    own = study(tmp_path, SEARCH)
    found, plan, _ = swept(own, tmp_path / "out", Shuffled(worth))
    figures: dict[str, Any] = {}
    console = Terminal(io.StringIO())
    console.result = lambda **values: figures.update(values)
    assert report(own, found, plan, tmp_path / "out", (), console, is_whole=False) == 6
    assert figures["interrupted"] is True
    assert (figures["prints"], figures["failed"], figures["indices"]) == (15, 6, None)
    assert isinstance(plan, OptimisePlan)
    assert figures["best"] == {"trial": 1, "value": 2.0, "keys": plan.settings[1]}


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
    of_std = found.sel(metric="std")
    for finish, expected in (("even", [1.0, 0.0]), ("fast", [0.0, 1.0])):
        for name in ("first_order", "total_order"):
            np.testing.assert_allclose(of_std[name].sel({FINISH: finish}).values, expected, atol=0.45)
        figures = found["std"].sel({FINISH: finish}).values.mean(axis=-1)  # none of a point of which a print failed
        blocks = {name: figures[found["block"].values == name] for name in ("A", "B", f"AB {ALPHA}", f"AB {VARIATION}")}
        a, b, *ab = blocks.values()
        own = sensitivity.indices(a, b, np.array(ab), 5)
        assert own.points == (31 if finish == "even" else 32)
        np.testing.assert_array_equal(of_std["total_order_low"].sel({FINISH: finish}), own.low[1])
        np.testing.assert_array_equal(of_std["first_order_high"].sel({FINISH: finish}), own.high[0])
        np.testing.assert_array_equal(of_std["first_order_error"].sel({FINISH: finish}), own.error[0])
    assert found["total_order_low"].attrs["long_name"].startswith("lower end of the 95% interval of the share")
    assert found["total_order_high"].attrs["long_name"].startswith("upper end of the 95% interval of the share")


def test_key_that_holds_another_and_a_search_with_changing_seeds_are_refused(tmp_path: Path) -> None:
    until = SEARCH.replace("count = 3", 'count = 3\nmax = 5\nuntil = { metric = "layers", standard_error = 1.0 }')
    with pytest.raises(ScenarioError, match=r"seeds\.until does not go with \[optimise\]") as caught:
        study(tmp_path, until)
    assert len(caught.value.errors) == 1
    text = '[vary]\n"grid" = [{ nx = 14, ny = 14 }]\n"grid.nx" = [13, 14]\n'
    with pytest.raises(ScenarioError) as caught:
        study(tmp_path, text)
    assert '"grid" holds "grid.nx"; keep one of them' in str(caught.value)
    assert study(tmp_path, f'title = "other"\n{SEARCH}').title == "other"


def test_scenario_that_has_changed_is_another_study(tmp_path: Path) -> None:
    own = study(tmp_path, SEARCH)
    text = own.scenario.text
    StudyFolder(tmp_path / "out", own, Bundle.of(text, SCENARIO))
    with pytest.raises(ResultError, match="changed since then: the scenario or one of its files"):
        StudyFolder(tmp_path / "out", own, Bundle.of(f"# seen\n{text}", SCENARIO))


def test_report_counts_the_prints_that_have_ended(tmp_path: Path) -> None:
    def plant(task: Task) -> Record:
        return failed(task, "gave up") if task.key == (0, 0) else record(task, std=1e-6, layers=2.0)

    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n[seeds]\ncount = 3\n')
    found, plan, _ = swept(own, tmp_path / "out", Shuffled(plant, slots=1, interrupted_after=4))
    figures: dict[str, Any] = {}
    shown = io.StringIO()
    console = Terminal(shown)
    console.result = lambda **values: figures.update(values)
    assert report(own, found, plan, tmp_path / "out", (), console, is_whole=False) == 1
    assert (figures["prints"], figures["failed"], figures["best"]) == (4, 1, None)
    assert "1 print failed: gave up" in shown.getvalue()
    assert "4 of 6 prints of " in (tmp_path / "out" / "study.html").read_text(encoding="utf-8")


def test_study_of_indices_that_is_interrupted_before_its_first_print_is_reported(tmp_path: Path) -> None:
    own = study(tmp_path, f'[sample]\nmethod = "sobol-indices"\npoints = 8\n"{ALPHA}" = {{ uniform = [0.2, 1.0] }}\n')
    engine = Shuffled(lambda task: record(task, std=1e-6), interrupted_after=0)
    found, plan, _ = swept(own, tmp_path / "out", engine)
    assert report(own, found, plan, tmp_path / "out", ("png",), Terminal(io.StringIO()), is_whole=False) == 0


def test_points_of_a_sample_go_by_its_seed(tmp_path: Path) -> None:
    text = f'[sample]\nmethod = "halton"\npoints = 4\nseed = SEED\n"{ALPHA}" = {{ uniform = [0.1, 1.0] }}\n'
    one, other, same = (list(study(tmp_path, text.replace("SEED", seed)).points()) for seed in ("1", "2", "1"))
    assert one == same != other

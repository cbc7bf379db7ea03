"""Studies without prints: what a file asks for, what is printed next, and the file that comes of it."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
import xarray as xr

from inkloop.errors import ResultError, ScenarioError
from inkloop.report.terminal import Terminal
from inkloop.results import netcdf
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.distributions import Distribution, distribution
from inkloop_lab.sweep.figures import Expression
from inkloop_lab.sweep.optimise import OptimisePlan
from inkloop_lab.sweep.plan import standard_error
from inkloop_lab.sweep.report import report
from inkloop_lab.sweep.sensitivity import indices
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Order, Record, Task, failed, name_of, perform
from support.places import SCENARIOS
from support.sweeps import ISHIGAMI, SCENARIO, Shuffled, ishigami, record, study, swept

TWO_KEYS = """
[vary]
"components.controller.alpha" = [0.5, 0.8, 1.0]
components.controller.finish = ["even", "fast"]
"""


def alpha_of(task: Task) -> Record:
    """A print whose roughness is its alpha plus its seed, and which fails for "fast" with the third seed."""
    if task.replicate == 2 and task.overrides["components.controller.finish"] == "fast":
        return failed(task, "controller: gave up")
    return record(task, std=1e-6 * (task.overrides["components.controller.alpha"] + task.seed), layers=3.0)


def test_all_errors_of_a_study_are_reported_at_once(tmp_path: Path) -> None:
    faulty = """
metrc = "std"
[vary]
"components.controller.alfa" = [0.5]
"components.controler.horizon" = [1, 2]
"part.height_um" = [10.0, -3.0]
"run.layers_max" = 4
[sample]
metod = "sobol"
points = 16
"components.printer.variation" = { unifrm = [0.0, 0.4] }
"components.profiler.noise_std_um" = { uniform = [2.0, 0.4] }
[seeds]
count = 3
until = { metric = "mae", standard_error = 0.1 }
[optimise]
minimise = "mae + layers"
trials = 0
"""
    with pytest.raises(ScenarioError) as caught:
        study(tmp_path, faulty)
    text, expected = str(caught.value), (
        "metrc is not a key of this table; did you mean metric?",
        'vary."components.controller.alfa": components.controller.alfa is not a key of this table; did you mean alpha?',
        "there is no components.controler; did you mean components.controller?",
        'vary."part.height_um": part.height_um is -3.0; expected greater than 0',
        'vary."run.layers_max" is 4; expected a list of values',
        "sample.\"metod\" is 'sobol'; did you mean method?",
        'sample."components.printer.variation" has unifrm, which is no distribution; did you mean uniform?',
        "uniform is [2.0, 0.4]; expected [low, high] with low below high",
        "mae is a length: give standard_error_um, not standard_error",
        "has mae, which is no metric with its unit; write mae_um",
        "optimise.trials is 0; expected greater than or equal to 1",
    )  # fmt: skip
    assert [part for part in expected if part not in text] == []
    assert len(caught.value.errors) == len(expected)


def test_keys_that_do_not_go_together_are_refused(tmp_path: Path) -> None:
    faulty = """
[vary]
"grid.nx" = [12, 14]
"seed" = [1, 2]
"components.printer.variation" = [0.1, 0.2]
[sample]
method = "sobol-indices"
points = 6
"components.printer.variation" = { uniform = [0.0, 0.4] }
[keep]
maps = "final"
"""
    with pytest.raises(ScenarioError) as caught:
        study(tmp_path, faulty)
    assert [error.partition(";")[0] for error in caught.value.errors] == [
        '"components.printer.variation" is in vary and in sample',
        '"seed" is what [seeds] gives to each print',
        "sample.points is 6",
        "sample.points is 6",
        'keep.maps is "final", in one array, but grid.nx changes the grid',
    ]


def test_value_that_fits_with_another_key_only_is_no_error_of_the_study(tmp_path: Path) -> None:
    text = '[vary]\n"part.size_x_um" = [2106.048, 4000.0]\n"grid.nx" = [12, 18]\n'
    assert study(tmp_path, text).count == 4
    with pytest.raises(ScenarioError, match=r'vary."part.size_x_um": '):
        study(tmp_path, text.replace("12, 18", "12, 13"))


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os')",
        "mae_um + True",
        "mae_um.real",
        "(lambda: 1)()",
        "[mae_um]",
        "mae_um if 1 else 2",
        "max()",
        "abs(x=1)",
        "",
        "1 +",
    ],
)
def test_expression_takes_arithmetic_only(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected|no metric"):
        Expression(text)


def test_expression_reads_lengths_in_micrometres() -> None:
    metrics = {"mae": 2e-6, "std": 1e-6, "layers": 5.0}
    assert Expression("mae_um + 0.1 * layers ** 2 - max(std_um, -1)")(metrics) == pytest.approx(3.5, rel=1e-12, abs=0.0)
    assert math.isnan(Expression("sqrt(0 - mae_um)")(metrics))
    assert math.isnan(Expression("1 / (layers - 5)")(metrics))
    assert math.isnan(Expression("mismatch + mae_um")(metrics))


@pytest.mark.parametrize(
    ("table", "reference"),
    [
        ({"uniform": [1.0, 3.0]}, scipy.stats.uniform(1.0, 2.0)),
        ({"loguniform": [0.01, 10.0]}, scipy.stats.loguniform(0.01, 10.0)),
        ({"normal": [2.0, 0.5]}, scipy.stats.norm(2.0, 0.5)),
        ({"truncated-normal": [2.0, 0.5, 1.0, 2.2]}, scipy.stats.truncnorm(-2.0, 0.4, 2.0, 0.5)),
        ({"truncated-normal": [0.0, 1.0, 9.0, 10.0]}, scipy.stats.truncnorm(9.0, 10.0)),  # far in the tail
    ],
)
def test_distributions_are_those_of_scipy(table, reference) -> None:
    shares = np.array([0.0005, 0.1, 0.5, 0.77, 0.999])
    np.testing.assert_allclose(distribution(table).values(shares), reference.ppf(shares), rtol=1e-9)


def test_whole_numbers_and_choices_are_equally_likely() -> None:
    shares = (np.arange(1200) + 0.5) / 1200
    assert np.unique(distribution({"integers": [2, 5]}).values(shares), return_counts=True)[1].tolist() == [300] * 4
    assert Distribution("choice", ("a", "b", "c")).values(shares).count("b") == 400


def test_file_does_not_depend_on_the_order_or_on_interruptions(tmp_path: Path) -> None:
    own = study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 3\n")
    whole, _, _ = swept(own, tmp_path / "whole", Shuffled(alpha_of, slots=1))
    for seed in range(2):
        place = tmp_path / f"part-{seed}"
        engines = [Shuffled(alpha_of, 4, seed, interrupted_after=n) for n in (2, 5)] + [Shuffled(alpha_of, 2, seed)]
        for engine in engines:
            last, _, seen = swept(own, place, engine)
        assert sum(len(engine.begun) for engine in engines) < 18 + 2 * 4 + 1
        assert len(seen) == 18
        xr.testing.assert_identical(whole, last)
        assert (place / "sweep.nc").read_bytes() == (tmp_path / "whole" / "sweep.nc").read_bytes()


def test_sweep_is_labelled_by_keys_and_failing_prints_are_rows_with_their_error(tmp_path: Path) -> None:
    swept(study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 3\nfirst = 7\n"), tmp_path / "out", Shuffled(alpha_of))
    for sweep in (
        netcdf.read(tmp_path / "out/sweep.nc"),
        xr.load_dataset(tmp_path / "out/sweep.nc", engine="h5netcdf"),
    ):
        fast = sweep.sel({"components.controller.alpha": 0.8, "components.controller.finish": "fast"})
        assert fast["std"].dims == ("seed",)
        np.testing.assert_allclose(fast["std"], [7.8e-6, 8.8e-6, np.nan], rtol=1e-12)
        assert fast["error"].values.tolist() == ["", "", "controller: gave up"]
        assert fast["status"].values.tolist() == [1, 1, 5]
        assert sweep["status"].attrs["flag_meanings"].split()[5] == "failed"
        assert sweep["std"].attrs["units"] == "m"
        assert sweep["seed"].values.tolist() == [7, 8, 9]


@pytest.mark.system
def test_page_has_every_point_and_error_and_texts_of_users_are_no_html(tmp_path: Path) -> None:
    own = study(tmp_path, f'title = "alpha <i> & finish"\n{TWO_KEYS}[seeds]\ncount = 3\n')
    found, plan, _ = swept(own, tmp_path / "out", Shuffled(alpha_of))
    assert report(own, found, plan, tmp_path / "out", ("png",), Terminal(io.StringIO()), is_whole=True) == 3
    text = (tmp_path / "out/study.html").read_text(encoding="utf-8")
    assert "<h1>alpha &lt;i&gt; &amp; finish</h1>" in text
    assert "<i>" not in text
    assert "18 of 18 prints" in text
    assert "3 failed" in text
    assert "<li>3: controller: gave up</li>" in text
    rows = re.findall(r"<tr><td>(.*?)</td><td>(.*?)</td>.*</tr>", text)
    assert rows[0] == ("alpha 0.5, finish even", "2.50 ± 0.58")
    assert len(rows) == 6
    pictures = re.findall(r'<img src="(.*?)"', text)
    assert pictures
    assert all((tmp_path / "out" / name).is_file() for name in pictures)
    assert "<caption>mean over the seeds, ± its standard error</caption>" in text


def test_last_surfaces_are_kept_where_asked(tmp_path: Path) -> None:
    def surface(task: Task) -> Record:
        return replace(record(task, std=1e-6), height=np.full((12, 12), 1.0 * task.point))

    own = study(tmp_path, f'{TWO_KEYS}[keep]\nmaps = "final"\n')
    swept(own, tmp_path / "out", Shuffled(surface, interrupted_after=3))
    swept(own, tmp_path / "out", Shuffled(surface))
    height = netcdf.read(tmp_path / "out/sweep.nc")["height"]
    assert height.dims[-2:] == ("x", "y")
    np.testing.assert_array_equal(height[..., 4, 5].values.ravel(), np.arange(6.0))


def test_print_without_a_whole_file_is_printed_again(tmp_path: Path) -> None:
    own = study(tmp_path, TWO_KEYS)
    whole, _, _ = swept(own, tmp_path / "out", Shuffled(alpha_of))
    found = tmp_path / "out/prints/00002-0000.json"
    found.rename(found.with_name(".00002-0000.json.part"))  # a kill between writing and renaming
    engine = Shuffled(alpha_of)
    again, _, _ = swept(own, tmp_path / "out", engine)
    assert engine.begun == [(2, 0)]
    xr.testing.assert_identical(whole, again)
    found.write_text("{")
    with pytest.raises(ResultError, match=r"00002-0000\.json: is no record of a print .*; delete it to print again"):
        swept(own, tmp_path / "out", engine)


def test_changed_study_is_refused_and_more_seeds_are_not(tmp_path: Path) -> None:
    swept(study(tmp_path, TWO_KEYS), tmp_path / "out", Shuffled(alpha_of))
    more = study(tmp_path, f"{TWO_KEYS}[seeds]\ncount = 2\n")
    assert len(swept(more, tmp_path / "out", Shuffled(alpha_of))[2]) == 12
    with pytest.raises(ResultError, match=r"changed since then: vary, sample or seeds\.first"):
        swept(study(tmp_path, TWO_KEYS.replace("0.8", "0.7")), tmp_path / "out", Shuffled(alpha_of))


def test_until_stops_where_the_standard_error_says(tmp_path: Path) -> None:
    text = f'{TWO_KEYS}[seeds]\ncount = 3\nmax = 60\nuntil = {{ metric = "std", standard_error_um = 0.1 }}\n'

    def scattered(task: Task) -> Record:
        scale = task.overrides["components.controller.alpha"] * (
            1 + 9 * (task.overrides["components.controller.finish"] == "fast")
        )
        return record(task, std=1e-6 * scale * np.random.default_rng(task.seed).normal())

    own = study(tmp_path, text)
    few, _, _ = swept(own, tmp_path / "few", Shuffled(scattered, slots=1))
    for engine in (Shuffled(scattered, slots=9, seed=4, interrupted_after=60), Shuffled(scattered, slots=9, seed=5)):
        many, _, _ = swept(own, tmp_path / "many", engine)
    xr.testing.assert_identical(few, many)
    counts = []
    for values in few["std"].values.reshape(6, -1):
        known = 1e6 * values[np.isfinite(values)]
        counts.append(len(known))
        assert standard_error(known) <= 0.1 or len(known) == 60
        assert standard_error(known[: len(known) // 2]) > 0.1 or len(known) == 3
    assert max(counts) == 60 > min(counts)


def test_indices_of_ishigami_are_within_three_bootstrap_errors(tmp_path: Path) -> None:
    keys = ("components.printer.variation", "components.profiler.noise_std_um", "components.controller.alpha")
    lines = "\n".join(f'"{key}" = {{ uniform = [0.0, 0.4] }}' for key in keys)
    own = study(tmp_path, f'[sample]\nmethod = "sobol-indices"\npoints = 512\n{lines}\n')

    def plant(task: Task) -> Record:
        return record(task, std=ishigami([math.pi * (task.overrides[key] / 0.2 - 1.0) for key in keys]))

    sweep, _, seen = swept(own, tmp_path / "out", Shuffled(plant, slots=8))
    assert len(seen) == 2560
    values = [sweep.sel(metric="std")[name].sel(key=list(keys)).values for name in ("first_order", "total_order")]
    errors = [sweep.sel(metric="std")[f"{name}_error"].values for name in ("first_order", "total_order")]
    assert np.all(np.abs(values - ISHIGAMI) <= 3.0 * np.array(errors))
    assert np.max(errors) < 0.09
    block, figures = sweep["block"].values, sweep["std"].values[:, 0]
    ab = np.stack([figures[block == f"AB {key}"] for key in keys])
    theirs = scipy.stats.sobol_indices(
        func={"f_A": figures[None, block == "A"], "f_B": figures[None, block == "B"], "f_AB": ab[:, None]}, n=512
    )
    np.testing.assert_allclose(values, [np.ravel(theirs.first_order), np.ravel(theirs.total_order)], rtol=1e-9)


def test_indices_leave_out_points_whose_prints_failed() -> None:
    a, b, ab = np.random.default_rng(1).random((3, 64))
    a[5], b[9] = np.nan, np.nan
    kept = np.isfinite(a) & np.isfinite(b)
    found, expected = indices(a, b, ab[None]), indices(a[kept], b[kept], ab[None, kept])
    assert found.points == 62
    np.testing.assert_array_equal(found.values, expected.values)
    assert np.isnan(indices(a[:4], b[:4], ab[None, :4]).values).all()


def test_resumed_search_asks_for_the_same_points(tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    text = """
[optimise]
minimise = "std_um + 0.1 * layers"
trials = 16
[vary]
"components.controller.horizon" = [1, 2, 3]
[sample]
"components.controller.alpha" = { uniform = [0.2, 1.0] }
[seeds]
count = 2
"""

    def valley(task: Task) -> Record:
        alpha, horizon = (task.overrides[f"components.controller.{name}"] for name in ("alpha", "horizon"))
        return record(task, std=1e-6 * (alpha - 0.6) ** 2 + 1e-8 * task.seed, layers=float(abs(horizon - 2)))

    own = study(tmp_path, text)
    whole, plan, _ = swept(own, tmp_path / "whole", Shuffled(valley, slots=1))
    for engine in (Shuffled(valley, 5, 1, interrupted_after=13), Shuffled(valley, 3, 2)):
        again, _, _ = swept(own, tmp_path / "parts", engine)
    xr.testing.assert_identical(whole, again)
    assert isinstance(plan, OptimisePlan)
    assert plan.best is not None
    alphas = whole["components.controller.alpha"].values
    assert len(np.unique(alphas)) == 16
    assert plan.settings[plan.best]["components.controller.horizon"] == 2
    assert abs(alphas[plan.best] - 0.6) < 0.15


@pytest.mark.parametrize(("aim", "best"), [("minimise", min), ("maximise", max)])
def test_best_trial_is_the_one_that_the_study_asks_for(aim: str, best: Any, tmp_path: Path) -> None:
    pytest.importorskip("optuna", reason="inkloop[optimise] is not installed")
    text = f"""
[optimise]
{aim} = "layers"
trials = 4
[sample]
"components.controller.alpha" = {{ uniform = [0.2, 1.0] }}
"""

    def slope(task: Task) -> Record:
        return record(task, layers=10.0 * task.overrides["components.controller.alpha"])

    _, plan, _ = swept(study(tmp_path, text), tmp_path / "made", Shuffled(slope))
    assert isinstance(plan, OptimisePlan)
    assert plan.best is not None
    assert len(set(plan.values)) == 4
    assert plan.values[plan.best] == best(plan.values)


def test_scenario_with_its_files_is_the_same_in_another_folder(tmp_path: Path) -> None:
    for name in ("lithophane", "bracket"):
        scenario = Scenario.load(SCENARIOS / f"{name}.toml")
        bundle = Bundle.of(scenario.text, SCENARIOS / f"{name}.toml")
        assert bundle.files
        moved = Scenario.load(bundle.write(tmp_path / name))
        assert moved.part_sha256 == scenario.part_sha256


def test_classes_next_to_a_scenario_go_with_it(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("")
    bundle = Bundle.of('[components.printer]\nkind = "mine:Plant"\n', tmp_path / "mine.toml")
    assert list(bundle.files) == ["mine.py"]


def test_print_of_a_task_is_that_of_a_run(tmp_path: Path) -> None:
    overrides = {"components.controller.horizon": 1, "components.controller.annealing_sweeps": 1}
    task = Task(0, 0, 5, overrides)
    text = SCENARIO.read_text()
    found = [perform(Order(text, str(SCENARIO), runs, True), task) for runs in (None, str(tmp_path))]
    run = Result.load(tmp_path / name_of(task.key))
    for each in found:
        assert each.metrics == run.metrics()
        np.testing.assert_array_equal(each.height, run.final_height)
    broken = perform(Order(text, str(SCENARIO), None, True), Task(0, 0, 5, {"part.height_um": -1.0}))
    assert (broken.status, broken.metrics) == ("failed", {})
    assert "part.height_um is -1.0" in broken.error


def test_shipped_studies_are_valid() -> None:
    paths = sorted((SCENARIOS / "studies").glob("*.toml"))
    assert len(paths) >= 3
    assert all(Study.load(path).tables.title for path in paths)

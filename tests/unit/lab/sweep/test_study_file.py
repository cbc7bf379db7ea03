"""A study file: its errors, its expressions and distributions, and the points that it asks for."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.stats
from scipy.stats import qmc

from inkloop.errors import ScenarioError
from inkloop_lab.sweep.figures import Expression
from inkloop_lab.sweep.sampling import Distribution, distribution, sampled
from inkloop_lab.sweep.study import Study, _errors_of_keys
from inkloop_lab.sweep.tables import SeedsTable, StudyFile, Until, axes_of
from support.places import SCENARIOS
from support.sweeps import SCENARIO, study

ALPHA, FINISH = "components.controller.alpha", "components.controller.finish"
UNIT = {"a": Distribution("uniform", (0.0, 1.0)), "b": Distribution("uniform", (2.0, 4.0))}


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
    variation = '"components.printer.variation"'
    faulty = f"""
[vary]
"grid.nx" = [12, 14]
"seed" = [1, 2]
{variation} = [0.1, 0.2]
[sample]
method = "sobol-indices"
points = 6
{variation} = {{ uniform = [0.0, 0.4] }}
[keep]
maps = "final"
"""
    with pytest.raises(ScenarioError) as caught:
        study(tmp_path, faulty)
    assert [error.partition(";")[0] for error in caught.value.errors] == [
        f"{variation} is in vary and in sample",
        '"seed" is what [seeds] gives to each print',
        "sample.points is 6",
        "sample.points is 6",
        'keep.maps is "final", in one array, but grid.nx changes the grid',
    ]
    with pytest.raises(ScenarioError, match=r'"grid" holds "grid\.nx"; keep one of them'):
        study(tmp_path, '[vary]\n"grid" = [{ nx = 14, ny = 14 }]\n"grid.nx" = [13, 14]\n')


def test_value_that_fits_with_another_key_only_is_no_error_of_the_study(tmp_path: Path) -> None:
    text = '[vary]\n"part.size_x_um" = [2106.048, 4000.0]\n"grid.nx" = [12, 18]\n'
    assert study(tmp_path, text).count == 4
    with pytest.raises(ScenarioError, match=r'vary."part.size_x_um": '):
        study(tmp_path, text.replace("12, 18", "12, 13"))


OPTIMISE, SPREAD = "[optimise]\ntrials = 3\nminimise = 'layers'", "K = { uniform = [0.1, 0.4] }"
UNTIL = "max = 5\nuntil = { metric = 'layers', standard_error = 1.0 }"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"[sample]\nmethod = 'sobol'\npoints = 6\n{SPREAD}", "balanced for 4 or 8"),
        (f"[sample]\nmethod = 'sobol-indices'\npoints = 4\n{SPREAD}", "expected at least 8"),
        (f"[sample]\npoints = 4\n{SPREAD}", "sample.method and sample.points are missing"),
        ("[sample]\nmethod = 'halton'\npoints = 4", "sample has no key; give one"),
        (OPTIMISE, "optimise has nothing to choose"),
        (f"{OPTIMISE}\nmaximise = 'layers'\n[vary]\nK = [0.1, 0.4]", "give one of mini"),
        (f"{OPTIMISE}\n[sample]\npoints = 4\n{SPREAD}", "sample has method or points, but"),
        (
            f"{OPTIMISE}\n[sample]\nK = {{ normal = [0.5, 0.1] }}",
            "is normal; expected uniform, loguniform, integers or choice",
        ),
        (f"{OPTIMISE}\n[sample]\n{SPREAD}\n[seeds]\ncount = 3\n{UNTIL}", r"seeds\.until does not go with \[optimise\]"),
        ("[vary]\nK = [0.1, 0.1]", "expected each value once"),
        ("[vary]\nK = []", "expected a list of values"),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\nmax = 5", "until and max go together"),
        (f"[vary]\nK = [0.1, 0.2]\n[seeds]\n{UNTIL}", "count is 1; with until it is from 2"),
        (
            f"[seeds]\ncount = 2\n{UNTIL.replace('error =', 'error_um =')}",
            "layers is no length: give standard_error, not standard_error_um",
        ),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\nfirst = -1", "seeds.first is -1"),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\ncount = 0", "seeds.count is 0"),
        (
            f"[sample]\nmethod = 'halton'\npoints = 20000\n{SPREAD}\n[seeds]\ncount = 51",
            "has 20000 points of 51 prints; at most 1000000 prints",
        ),
        ("[components.printer]\nkind = 'x'", "is a scenario; name it in a study file"),
    ],
)
def test_study_that_cannot_be_printed_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        study(tmp_path, text.replace("K =", f'"{ALPHA}" =') + "\n")
    assert len(caught.value.errors) == 1


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        (str(SCENARIO.with_name("bench.toml")), r"components\.printer is a device; a study prints on models"),
        ("cuboid.json", r"expected a scenario file \(\.toml\)"),
    ],
)
def test_study_prints_a_scenario_of_models(scenario: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "study.toml"
    path.write_text(f"scenario = {json.dumps(scenario)}\n")
    with pytest.raises(ScenarioError, match=message):
        Study.load(path)


def test_points_are_every_pair_of_values_and_samples(tmp_path: Path) -> None:
    sample = f'[sample]\nmethod = "halton"\npoints = 3\nseed = 1\n"{ALPHA}" = {{ uniform = [0.2, 0.4] }}\n'
    text = f'[vary]\n"{FINISH}" = ["even", "fast"]\n{sample}[seeds]\ncount = 2\n'
    own, same, other = (study(tmp_path, text.replace("seed = 1", f"seed = {seed}")) for seed in (1, 1, 2))
    assert own.samples is not None
    alphas = own.samples.values[ALPHA]
    assert list(own.points()) == [{FINISH: finish, ALPHA: alpha} for finish in ("even", "fast") for alpha in alphas]
    assert list(own.points()) == list(same.points()) != list(other.points())
    assert (own.count, own.shape) == (6, {FINISH: 2, "sample": 3})
    assert own.first_seed == own.scenario.tables.seed
    assert study(tmp_path, f'[vary]\n"{FINISH}" = ["even"]\n[seeds]\nfirst = 40\n').first_seed == 40
    assert study(tmp_path, f'[vary]\n"{FINISH}" = ["even"]\n[seeds]\nfirst = 0\n').first_seed == 0


def test_shipped_studies_are_valid() -> None:
    paths = sorted((SCENARIOS / "studies").glob("*.toml"))
    assert len(paths) >= 3
    assert all(Study.load(path).tables.title for path in paths)


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
        "1" + "+1" * 250,
    ],
)
def test_expression_takes_short_arithmetic_only(text: str) -> None:
    with pytest.raises(ValueError, match=r"expected|no metric|has 501 characters; at most 500"):
        Expression(text)


@pytest.mark.parametrize(
    ("text", "metrics", "value"),
    [
        ("mae_um + 0.1 * layers ** 2 - max(std_um, -1)", {"mae": 2e-6, "std": 1e-6, "layers": 5.0}, 3.5),
        ("min(std_um, layers)", {"std": 2e-6, "layers": 5.0}, 2.0),
        ("max(std_um, layers, 1)", {"std": 2e-6, "layers": 5.0}, 5.0),
        ("abs(mean_error_um)", {"mean_error": -3e-6}, 3.0),
        ("sqrt(droplets)", {"droplets": 49.0}, 7.0),
        ("exp(mismatch)", {"mismatch": 0.5}, math.e**0.5),
        ("log(layers)", {"layers": 10.0}, 2.302585092994046),
        ("-rms_um / 4 + +min_um - max_um", {"rms": 8e-6, "min": -1e-6, "max": 6e-6}, -9.0),
        ("2 ** layers * mae_um", {"layers": 3.0, "mae": 1.5e-6}, 12.0),
        ("1" + "+1" * 249, {}, 250.0),
        ("sqrt(0 - mae_um)", {"mae": 2e-6}, math.nan),
        ("1 / (layers - 5)", {"layers": 5.0}, math.nan),
        ("mismatch + mae_um", {"mae": 2e-6}, math.nan),
        ("layers * 1" + "0" * 400, {"layers": 1.0}, math.nan),
    ],
)
def test_expression_reads_lengths_in_micrometres(text: str, metrics: Mapping[str, float], value: float) -> None:
    assert Expression(text)(metrics) == pytest.approx(value, rel=1e-12, abs=0.0, nan_ok=True)


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
def test_distributions_are_those_of_scipy(table: dict[str, Any], reference: Any) -> None:
    shares = np.array([0.0005, 0.1, 0.5, 0.77, 0.999])
    np.testing.assert_allclose(distribution(table).values(shares), reference.ppf(shares), rtol=1e-9)


def test_ends_of_a_distribution_are_finite_and_no_value_lies_beyond_them() -> None:
    low, high = Distribution("normal", (2.0, 0.5)).values(np.array([0.0, 1.0]))
    assert math.isfinite(low)
    assert math.isfinite(high)
    assert (2.0 - low, high - 2.0) == pytest.approx((3.517, 3.517), abs=1e-3)  # 7.034 deviations: a share of 1e-12
    for kind, parameters in (
        ("loguniform", (0.1, 0.3)),
        ("uniform", (0.3, 0.9)),
        ("truncated-normal", (0.0, 1.0, 0.1, 0.3)),
    ):
        spread = Distribution(kind, parameters)
        assert spread.values(np.array([0.0, 1.0])) == list(parameters[-2:])
    assert Distribution("integers", (2, 5)).values(np.array([0.0, 0.9999, 1.0])) == [2, 5, 5]
    assert Distribution("choice", ("a", "b")).values(np.array([0.0, 0.49, 1.0])) == ["a", "a", "b"]


def test_random_points_are_those_of_the_seed() -> None:
    found, expected = sampled("random", 5, 3, UNIT), np.random.default_rng(3).random((5, 2))
    np.testing.assert_array_equal(found.values["a"], expected[:, 0])
    np.testing.assert_allclose(found.values["b"], 2.0 + 2.0 * expected[:, 1], rtol=1e-12)


def test_a_million_prints_are_a_study(tmp_path: Path) -> None:
    text = (
        f'[sample]\nmethod = "random"\npoints = 10\n"{ALPHA}" = {{ uniform = [0.2, 0.4] }}\n[seeds]\ncount = 100000\n'
    )
    assert study(tmp_path, text).count == 10
    with pytest.raises(ScenarioError, match="has 11 points of 100000 prints; at most 1000000 prints"):
        study(tmp_path, text.replace("points = 10", "points = 11"))


def test_scenario_of_the_package_is_named_without_a_suffix_and_a_file_lies_beside_the_study(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text(SCENARIO.read_text().replace("title =", "# mine\ntitle ="))
    for name in ("cuboid", "own.toml"):
        (tmp_path / "study.toml").write_text(f'scenario = "{name}"\n')
        found = Study.load(tmp_path / "study.toml")
        assert ("# mine" in found.scenario.text) == (name == "own.toml")
        assert found.title == found.scenario.tables.title
    (tmp_path / "study.toml").write_text('title = "Mine"\nscenario = "cuboid"\n')
    assert Study.load(tmp_path / "study.toml").title == "Mine"


def test_value_as_a_number_and_as_a_text_are_two_values() -> None:
    errors: list[str] = []
    assert list(axes_of({"a": {"b": [1, "1"]}, "c": [1, 1.0]}, errors)) == [("a.b", [1, "1"]), ("c", [1, 1.0])]
    assert errors == []
    assert list(axes_of({"a": [1, 2, 1]}, errors)) == []
    assert errors == ['vary."a" is [1, 2, 1]; expected each value once']


def test_key_is_held_by_another_one_only_as_its_table(tmp_path: Path) -> None:
    """`run.layers_max` and `run.layers` begin alike, and none is in the other."""
    found = list(study_errors({"run.layers": [1], "run.layers_max": [2]}))
    assert found == []
    assert study_errors({"run": [1], "run.layers_max": [2]}) == ['"run" holds "run.layers_max"; keep one of them']


def study_errors(axes: dict[str, Any]) -> list[str]:
    tables = StudyFile.model_validate({"scenario": "cuboid"})
    return list(_errors_of_keys(tables, axes, {}))


@pytest.mark.parametrize(("points", "is_balanced"), [(16, True), (12, False), (15, False), (1, True)])
def test_sobol_points_are_a_power_of_two(points: int, is_balanced: bool) -> None:
    tables = StudyFile.model_validate({"scenario": "cuboid", "sample": {"method": "sobol", "points": points}})
    errors = list(_errors_of_keys(tables, {}, UNIT))
    assert errors == ([] if is_balanced else [f"sample.points is {points}; Sobol' points are balanced for 8 or 16"])


def test_goal_is_that_of_the_unit_of_its_metric() -> None:
    assert Until(metric="mae", standard_error_um=0.25).goal == 0.25
    assert Until(metric="layers", standard_error=1.5).goal == 1.5
    with pytest.raises(ValueError, match="mae is a length: give standard_error_um, not standard_error"):
        Until(metric="mae", standard_error_um=0.25, standard_error=1.0)
    table = {"count": 3, "max": 3, "until": {"metric": "layers", "standard_error": 1.0}}
    assert SeedsTable.model_validate(table).max == 3
    with pytest.raises(ValueError, match="count is 4; with until it is from 2, which give a first error, to max"):
        SeedsTable.model_validate({**table, "count": 4})


def test_whole_numbers_and_choices_are_equally_likely_and_a_study_checks_the_ends() -> None:
    shares, whole, choice = (np.arange(1200) + 0.5) / 1200, distribution({"integers": [2, 5]}), ("a", "b", "c")
    assert np.unique(whole.values(shares), return_counts=True)[1].tolist() == [300] * 4
    assert Distribution("choice", choice).values(shares).count("b") == 400
    assert Distribution("uniform", (1.0, 3.0)).extremes() == [1.0, 3.0]
    assert whole.extremes() == [2, 5]
    assert Distribution("choice", choice).extremes() == ["a", "b", "c"]
    low, high = Distribution("normal", (2.0, 0.5)).extremes()
    assert (low - 2.0, high - 2.0) == pytest.approx((-0.5 * 3.090232, 0.5 * 3.090232), rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({}, "expected one distribution: uniform, loguniform, normal, truncated-normal, integers, choice"),
        ({"uniform": 3}, r"uniform is 3; expected \[low, high\]"),
        ({"uniform": [1.0]}, r"uniform is \[1.0\]; expected \[low, high\]$"),
        ({"uniform": [2.0, 2.0]}, "with low below high"),
        ({"uniform": [True, 2.0]}, r"expected \[low, high\], numbers"),
        ({"uniform": [0.0, math.inf]}, r"expected \[low, high\], numbers"),
        ({"loguniform": [0.0, 2.0]}, "with low above 0"),
        ({"normal": [1.0, 0.0]}, r"expected \[mean, std\] with std above 0"),
        ({"truncated-normal": [1.0, -1.0, 0.0, 2.0]}, r"\[mean, std, low, high\] with std above 0"),
        ({"truncated-normal": [1.0, 1.0, 3.0, 2.0]}, r"expected \[mean, std, low, high\] with low below high"),
        ({"integers": [1, 2.5]}, r"expected \[first, last\], whole numbers"),
        ({"integers": [3, 3]}, "with first below last"),
        ({"choice": ["a"]}, "expected a list of two values or more"),
        ({"choice": "ab"}, "expected a list of values"),
    ],
)
def test_distribution_that_is_none_is_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        distribution(table)


@pytest.mark.parametrize(
    ("method", "engine"), [("sobol", qmc.Sobol), ("halton", qmc.Halton), ("latin-hypercube", qmc.LatinHypercube)]
)
def test_points_are_those_of_scipy(method: str, engine: Any) -> None:
    found, expected = sampled(method, 16, 5, UNIT), engine(2, rng=5).random(16)
    np.testing.assert_allclose(found.values["a"], expected[:, 0], rtol=1e-12)
    np.testing.assert_allclose(found.values["b"], 2.0 + 2.0 * expected[:, 1], rtol=1e-12)
    assert (found.blocks, len(found)) == ((), 16)
    assert found.overrides(3) == {"a": found.values["a"][3], "b": found.values["b"][3]}


def test_blocks_of_saltelli_exchange_one_key() -> None:
    found = sampled("sobol-indices", 8, 1, UNIT)
    blocks = {name: [n for n, own in enumerate(found.blocks) if own == name] for name in dict.fromkeys(found.blocks)}
    assert list(blocks) == ["A", "B", "AB a", "AB b"]
    points = {name: [tuple(found.overrides(n).values()) for n in numbers] for name, numbers in blocks.items()}
    for a, b, ab_a, ab_b in zip(*points.values(), strict=True):
        assert (ab_a, ab_b) == ((b[0], a[1]), (a[0], b[1]))
    assert len(set(points["A"]) | set(points["B"])) == 16

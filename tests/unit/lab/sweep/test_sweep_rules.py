"""Choice of points and seeds of a study, and the checks of its file: figures worked out by hand or by SciPy."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import qmc

from inkloop.errors import ComponentError, ResultError, ScenarioError
from inkloop_lab.sweep import bundle as bundles
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.dataset import FAILING, STATUSES, coordinate, dataset, unit_of
from inkloop_lab.sweep.distributions import Distribution, distribution
from inkloop_lab.sweep.figures import METRICS, Expression
from inkloop_lab.sweep.folder import StudyFolder
from inkloop_lab.sweep.plan import PointsPlan, seeds_wanted, standard_error
from inkloop_lab.sweep.sampling import sampled
from inkloop_lab.sweep.sensitivity import indices
from inkloop_lab.sweep.tables import Until
from inkloop_lab.sweep.task import Order, Record, Task, perform
from support.sweeps import SCENARIO, Shuffled, record, study, swept

ALPHA, FINISH = "components.controller.alpha", "components.controller.finish"


def records(*stds_um: float | None) -> list[Record]:
    """Prints of a point; None: one that failed."""
    metrics: list[Mapping[str, float]] = [{} if std is None else {"std": std * 1e-6, "layers": std} for std in stds_um]
    return [Record(0, number, "done" if each else "failed", each) for number, each in enumerate(metrics)]


@pytest.mark.parametrize(
    ("stds", "goal", "most", "more"),
    [
        ((1.0, 3.0), 1.0, 99, 0),  # standard error 1
        ((1.0, 3.0), 0.9, 99, 1),  # 2 / 0.9^2 = 2.5 prints
        ((1.0, 3.0), 0.5, 99, 2),  # 8 prints, no more than doubled
        ((1.0, 3.0, 1.0, 3.0), 0.4, 99, 5 - 1),  # standard error 0.577: 8.3 prints, no more than doubled
        ((1.0, 3.0, 1.0, 3.0), 0.5, 99, 2),  # 5.3 prints
        ((1.0, 3.0, 1.0, 3.0), 0.4, 6, 2),
        ((1.0, 3.0, 1.0, 3.0), 0.4, 4, 0),
        ((1.0, None), 0.1, 99, 0),  # a scatter that nobody knows
        ((None, None), 0.1, 99, 0),
        ((1.0, 3.0, None), 0.5, 99, 3),  # 8 prints that do not fail
    ],
)
def test_further_seeds_are_those_that_the_scatter_asks_for(
    stds: tuple[float | None, ...], goal: float, most: int, more: int
) -> None:
    assert seeds_wanted(records(*stds), Until(metric="std", standard_error_um=goal), most) == more
    assert seeds_wanted(records(*stds), Until(metric="layers", standard_error=goal), most) == more


def test_standard_error_is_that_of_the_mean() -> None:
    assert standard_error([1.0, 3.0, 5.0]) == pytest.approx(2.0 / math.sqrt(3.0), rel=1e-12, abs=0.0)
    assert math.isnan(standard_error([1.0]))


def test_plan_counts_the_seeds_that_it_adds(tmp_path: Path) -> None:
    text = f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n'
    own = study(tmp_path, f'{text}[seeds]\ncount = 2\nmax = 9\nuntil = {{ metric = "std", standard_error_um = 0.5 }}\n')
    plan = PointsPlan(own)
    tasks = list(plan.begin())
    assert [task.key for task in tasks] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert plan.total == 4
    assert [task.overrides[ALPHA] for task in tasks] == [0.5, 0.5, 0.8, 0.8]
    assert not plan.after(record(tasks[3], std=3e-6))
    further = plan.after(record(tasks[2], std=1e-6))
    assert [(task.key, task.seed - tasks[2].seed, task.overrides) for task in further] == [
        ((1, 2), 2, {ALPHA: 0.8}), ((1, 3), 3, {ALPHA: 0.8}),
    ]  # fmt: skip
    assert plan.total == 6


@pytest.mark.parametrize(
    ("text", "metrics", "value"),
    [
        ("min(std_um, layers)", {"std": 2e-6, "layers": 5.0}, 2.0),
        ("max(std_um, layers, 1)", {"std": 2e-6, "layers": 5.0}, 5.0),
        ("abs(mean_error_um)", {"mean_error": -3e-6}, 3.0),
        ("sqrt(droplets)", {"droplets": 49.0}, 7.0),
        ("exp(mismatch)", {"mismatch": 0.5}, math.e**0.5),
        ("log(layers)", {"layers": 10.0}, 2.302585092994046),
        ("-rms_um / 4 + +min_um - max_um", {"rms": 8e-6, "min": -1e-6, "max": 6e-6}, -9.0),
        ("2 ** layers * mae_um", {"layers": 3.0, "mae": 1.5e-6}, 12.0),
    ],
)
def test_expression_has_its_value(text: str, metrics: Mapping[str, float], value: float) -> None:
    assert Expression(text)(metrics) == pytest.approx(value, rel=1e-12, abs=0.0)


def test_expression_that_is_too_long_is_refused() -> None:
    assert Expression("1" + "+1" * 249)({}) == 250.0
    with pytest.raises(ValueError, match="has 501 characters; at most 500"):
        Expression("1" + "+1" * 250)


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


def test_study_checks_the_ends_of_a_distribution() -> None:
    assert Distribution("uniform", (1.0, 3.0)).extremes() == [1.0, 3.0]
    assert Distribution("integers", (2, 5)).extremes() == [2, 5]
    assert Distribution("choice", ("a", "b", "c")).extremes() == ["a", "b", "c"]
    low, high = Distribution("normal", (2.0, 0.5)).extremes()
    assert (low - 2.0, high - 2.0) == pytest.approx((-0.5 * 3.090232, 0.5 * 3.090232), rel=1e-6, abs=0.0)


@pytest.mark.parametrize(
    ("method", "engine"),
    [("sobol", qmc.Sobol), ("halton", qmc.Halton), ("latin-hypercube", qmc.LatinHypercube)],
)
def test_points_are_those_of_scipy(method: str, engine: Any) -> None:
    keys = {"a": Distribution("uniform", (0.0, 1.0)), "b": Distribution("uniform", (2.0, 4.0))}
    found = sampled(method, 16, 5, keys)
    expected = engine(2, rng=5).random(16)
    np.testing.assert_allclose(found.values["a"], expected[:, 0], rtol=1e-12)
    np.testing.assert_allclose(found.values["b"], 2.0 + 2.0 * expected[:, 1], rtol=1e-12)
    assert (found.blocks, len(found)) == ((), 16)
    assert found.overrides(3) == {"a": found.values["a"][3], "b": found.values["b"][3]}


def test_blocks_of_saltelli_exchange_one_key() -> None:
    keys = {"a": Distribution("uniform", (0.0, 1.0)), "b": Distribution("uniform", (2.0, 4.0))}
    found = sampled("sobol-indices", 8, 1, keys)
    blocks = {name: [n for n, own in enumerate(found.blocks) if own == name] for name in dict.fromkeys(found.blocks)}
    assert list(blocks) == ["A", "B", "AB a", "AB b"]
    points = {name: [tuple(found.overrides(n).values()) for n in numbers] for name, numbers in blocks.items()}
    for a, b, ab_a, ab_b in zip(*points.values(), strict=True):
        assert ab_a == (b[0], a[1])
        assert ab_b == (a[0], b[1])
    assert len(set(points["A"]) | set(points["B"])) == 16


def test_no_index_is_made_of_too_few_points_or_of_a_constant() -> None:
    a, b, ab = np.random.default_rng(1).random((3, 8))
    assert np.isfinite(indices(a, b, ab[None]).values).all()
    assert np.isnan(indices(a[:7], b[:7], ab[None, :7]).values).all()
    constant = indices(np.ones(64), np.ones(64), np.ones((2, 64)))
    assert np.isnan(constant.values).all()
    assert (constant.values.shape, constant.points) == ((2, 2), 64)


def test_intervals_of_indices_are_those_of_95_per_cent() -> None:
    """The estimates of many points are nearly normal: 3.92 standard errors wide, about the value."""
    rng = np.random.default_rng(4)
    a, b = rng.random((2, 2, 400))
    figures = [2.0 * x + y for x, y in (a, b, (b[0], a[1]), (a[0], b[1]))]
    found = indices(figures[0], figures[1], np.stack(figures[2:]))
    np.testing.assert_allclose(found.values, [[0.8, 0.2]] * 2, atol=0.12)
    np.testing.assert_allclose((found.high - found.low) / found.error, 3.92, rtol=0.08)
    np.testing.assert_allclose((found.high + found.low) / 2, found.values, atol=0.02)


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("components.profiler.noise_std_um", "um"),
        ("components.profiler.scan_duration_s", "s"),
        ("components.printer.variation", "1"),
        ("part.size_x_um", "um"),
        ("components.printer.layers", "1"),
    ],
)
def test_key_has_the_unit_of_its_name(key: str, unit: str) -> None:
    assert unit_of(key) == unit
    assert coordinate(key, "sample", [1.0, 2.0]).attrs["units"] == unit


def test_values_that_are_no_numbers_are_texts() -> None:
    assert coordinate("k", "k", ["even", [1, 2], True]).values.tolist() == ["even", "[1, 2]", "true"]
    assert coordinate("k", "k", [True, False]).values.tolist() == [True, False]
    assert coordinate("k", "k", [1, 2.5]).values.tolist() == [1.0, 2.5]


def test_file_says_what_it_holds(tmp_path: Path) -> None:
    def surface(task: Task) -> Record:
        found = replace(record(task, std=2e-6, layers=3.0), height=np.full((12, 12), 1e-6))
        return replace(found, wall_s=2.5) if task.replicate else Record(task.point, 0, "failed", error="gave up")

    own = study(
        tmp_path, f'title = "Two"\n[vary]\n"{ALPHA}" = [0.5, 0.8]\n[seeds]\ncount = 2\n[keep]\nmaps = "final"\n'
    )
    sweep, _, _ = swept(own, tmp_path / "out", Shuffled(surface))
    assert sweep.attrs["title"] == "Two"
    assert sweep.attrs["study"] == own.text
    assert sweep.attrs["scenario"] == SCENARIO.read_text()
    pitch = own.scenario.tables.grid.pitch
    np.testing.assert_allclose(sweep["x"], np.arange(12) * pitch, rtol=1e-12)
    np.testing.assert_allclose(sweep["y"], np.arange(12) * pitch, rtol=1e-12)
    assert np.isnan(sweep["height"].sel(seed=sweep["seed"][0])).all()
    np.testing.assert_array_equal(sweep["height"].sel(seed=sweep["seed"][1]), 1e-6)
    np.testing.assert_array_equal(sweep["wall_s"][:, 1], 2.5)
    assert {name: sweep[name].attrs["units"] for name in ("std", "layers", "wall_s", "height")} == {
        "std": "m", "layers": "1", "wall_s": "s", "height": "m",
    }  # fmt: skip
    assert sorted(set(METRICS) & set(sweep)) == ["layers", "std"]
    assert sweep["std"].attrs["long_name"].startswith("standard deviation of the error")


def test_surfaces_that_are_too_large_for_one_file_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n[keep]\nmaps = "final"\n')
    monkeypatch.setattr("inkloop_lab.sweep.dataset.MAPS_MAX", 2 * 144 * 8 - 1)
    folder = StudyFolder(tmp_path / "out", own, Bundle.of(own.scenario.text, SCENARIO))
    with pytest.raises(ResultError, match=r'keep.maps: all surfaces have .* GB; write keep.maps = "all"'):
        dataset(own, folder)


def test_folder_of_another_version_or_of_no_study_is_refused(tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n')
    bundle = Bundle.of(own.scenario.text, SCENARIO)
    StudyFolder(tmp_path, own, bundle)
    state = json.loads((tmp_path / "study.json").read_text())
    for found, message in (({**state, "schema_version": 3}, "schema version is 3"), ({}, "is no record of a study")):
        (tmp_path / "study.json").write_text(json.dumps(found))
        with pytest.raises(ResultError, match=message):
            StudyFolder(tmp_path, own, bundle)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sample]\nmethod = 'sobol'\npoints = 6\nK = { uniform = [0.1, 0.4] }", "balanced for 4 or 8"),
        ("[sample]\nmethod = 'sobol-indices'\npoints = 4\nK = { uniform = [0.1, 0.4] }", "expected at least 8"),
        ("[sample]\npoints = 4\nK = { uniform = [0.1, 0.4] }", "sample.method and sample.points are missing"),
        ("[sample]\nmethod = 'halton'\npoints = 4", "sample has no key; give one"),
        ("[optimise]\ntrials = 3\nminimise = 'layers'", "optimise has nothing to choose"),
        (
            "[optimise]\ntrials = 3\nminimise = 'layers'\nmaximise = 'layers'\n[vary]\nK = [0.1, 0.4]",
            "give one of mini",
        ),
        (
            "[optimise]\ntrials = 3\nminimise = 'layers'\n[sample]\npoints = 4\nK = { uniform = [0.1, 0.4] }",
            "sample has method or points, but",
        ),
        (
            "[optimise]\ntrials = 3\nminimise = 'layers'\n[sample]\nK = { normal = [0.5, 0.1] }",
            "is normal; expected uniform, loguniform, integers or choice to optimise",
        ),
        ("[vary]\nK = [0.1, 0.1]", "expected each value once"),
        ("[vary]\nK = []", "expected a list of values"),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\nmax = 5", "until and max go together"),
        (
            "[vary]\nK = [0.1, 0.2]\n[seeds]\nmax = 5\nuntil = { metric = 'layers', standard_error = 1.0 }",
            "count is 1; with until it is from 2",
        ),
        (
            "[seeds]\ncount = 2\nmax = 5\nuntil = { metric = 'layers', standard_error_um = 1.0 }",
            "layers is no length: give standard_error, not standard_error_um",
        ),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\nfirst = -1", "seeds.first is -1"),
        ("[vary]\nK = [0.1, 0.2]\n[seeds]\ncount = 0", "seeds.count is 0"),
        (
            "[sample]\nmethod = 'halton'\npoints = 20000\nK = { uniform = [0.1, 0.4] }\n[seeds]\ncount = 51",
            "has 20000 points of 51 prints; at most 1000000 prints",
        ),
    ],
)
def test_study_that_cannot_be_printed_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message) as caught:
        study(tmp_path, text.replace("K =", f'"{ALPHA}" ='))
    assert len(caught.value.errors) == 1


def test_scenario_or_device_is_no_study(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="is a scenario; name it in a study file"):
        study(tmp_path, "[components.printer]\nkind = 'x'\n")
    path = tmp_path / "bench.toml"
    path.write_text(f"scenario = {json.dumps(str(SCENARIO.with_name('bench.toml')))}\n")
    with pytest.raises(ScenarioError, match=r"components\.printer is a device; a study prints on models"):
        type(study(tmp_path, "")).load(path)
    path.write_text("scenario = 'cuboid.json'\n")
    with pytest.raises(ScenarioError, match=r"expected a scenario file \(\.toml\)"):
        type(study(tmp_path, "")).load(path)


def test_points_are_every_pair_of_values_and_samples(tmp_path: Path) -> None:
    own = study(
        tmp_path,
        f'[vary]\n"{FINISH}" = ["even", "fast"]\n[sample]\nmethod = "halton"\npoints = 3\n'
        f'"{ALPHA}" = {{ uniform = [0.2, 0.4] }}\n[seeds]\ncount = 2\n',
    )
    assert own.samples is not None
    alphas = own.samples.values[ALPHA]
    assert list(own.points()) == [{FINISH: finish, ALPHA: alpha} for finish in ("even", "fast") for alpha in alphas]
    assert (own.count, own.shape) == (6, {FINISH: 2, "sample": 3})
    assert own.first_seed == own.scenario.tables.seed
    assert study(tmp_path, f'[vary]\n"{FINISH}" = ["even"]\n[seeds]\nfirst = 40\n').first_seed == 40
    assert study(tmp_path, f'[vary]\n"{FINISH}" = ["even"]\n[seeds]\nfirst = 0\n').first_seed == 0


def test_print_that_is_finished_is_read_and_not_printed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    overrides = {"run.layers_max": 1, "components.controller.horizon": 1, "components.controller.annealing_sweeps": 1}
    order, task = Order(SCENARIO.read_text(), str(SCENARIO), str(tmp_path), False), Task(2, 1, 5, overrides)
    first = perform(order, task)
    assert (first.key, first.status, first.height) == ((2, 1), "layers_max", None)
    assert (tmp_path / "00002-0001" / "result.nc").is_file()
    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", None)
    again = perform(order, task)
    assert (again.status, again.metrics) == (first.status, first.metrics)


def test_print_that_was_stopped_is_read_as_nobody_has_looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    work = {"components.controller.horizon": 1, "components.controller.annealing_sweeps": 1}
    order = Order(SCENARIO.read_text(), str(SCENARIO), str(tmp_path), False)
    task = Task(2, 1, 5, {"components.controller.volume_least": 0.98, **work})
    assert perform(order, task).status == "stopped"
    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", None)
    assert perform(order, task).status == "stopped"
    assert "stopped" in STATUSES
    assert "stopped" in FAILING


def test_bundle_of_other_files_has_another_fingerprint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "case").mkdir()
    (tmp_path / "ink.toml").write_text("a = 1\n")
    text = 'ink = "../ink.toml"\nother = "nothing.toml"\nabsolute = "/etc/hostname"\nup = ".."\n'
    source = tmp_path / "case" / "case.toml"
    found = Bundle.of(text, source)
    assert (found.place, dict(found.files)) == ("case/case.toml", {"ink.toml": b"a = 1\n"})
    assert found.sha256 == Bundle.of(text, source).sha256
    (tmp_path / "ink.toml").write_text("a = 2\n")
    assert found.sha256 != Bundle.of(text, source).sha256
    (tmp_path / "case" / "more.toml").write_text("")
    assert sorted(Bundle.of("", source, [["more.toml", 3], {"k": "../ink.toml"}]).files) == [
        "case/more.toml", "ink.toml",
    ]  # fmt: skip
    monkeypatch.setattr(bundles, "BYTES_MAX", 5)
    with pytest.raises(ResultError, match="its files have 0 MB, of at most 0; put large ones"):
        Bundle.of(text, source)


def test_manifest_and_folder_bring_what_they_name(tmp_path: Path) -> None:
    (tmp_path / "slices").mkdir()
    for name in ("a.png", "b.png"):
        (tmp_path / "slices" / name).write_bytes(name.encode())
    (tmp_path / "layers.json").write_text(json.dumps({"images": ["slices/a.png", "slices/missing.png"], "pitch": 3}))
    assert sorted(Bundle.of('part = "layers.json"', tmp_path / "c.toml").files) == ["layers.json", "slices/a.png"]
    assert sorted(Bundle.of('part = "slices"', tmp_path / "c.toml").files) == ["slices/a.png", "slices/b.png"]
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "__init__.py").write_text("")
    (tmp_path / "pack" / "inner.py").write_text("")
    found = Bundle.of('kind = "pack.inner:Plant"', tmp_path / "c.toml")
    assert sorted(found.files) == ["pack/__init__.py", "pack/inner.py"]


@pytest.mark.parametrize(("keep", "stays"), [("layers = true", False), ('maps = "all"', True)])
def test_run_folder_goes_with_its_record_unless_runs_are_kept(keep: str, stays: bool, tmp_path: Path) -> None:
    own = study(tmp_path, f'[vary]\n"{ALPHA}" = [0.5, 0.8]\n[keep]\n{keep}\n')
    place = tmp_path / "out" / "prints" / "00001-0000"
    place.mkdir(parents=True)
    bundle = Bundle.of(own.scenario.text, SCENARIO)
    StudyFolder(tmp_path / "out", own, bundle).add(Record(1, 0, "done", {"std": 1e-6}, 0.5))
    assert place.is_dir() is stays
    (found,) = StudyFolder(tmp_path / "out", own, bundle).records.values()
    assert (found.key, found.status, found.metrics, found.wall_s) == ((1, 0), "done", {"std": 1e-6}, 0.5)


@pytest.mark.parametrize("runs", [False, True])
def test_error_of_a_print_is_the_message_of_its_cause(
    runs: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run folder adds advice to the message, which names the folder: it differs from machine to machine."""

    def broken(*_: object, **__: object) -> None:
        try:
            raise ComponentError("printer: out of ink")
        except ComponentError as error:
            raise ComponentError(f"printer: out of ink\nlayers 0 to 3 are in {tmp_path}") from error

    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", broken)
    order = Order(SCENARIO.read_text(), str(SCENARIO), str(tmp_path) if runs else None, False)
    found = perform(order, Task(0, 0, 5, {}))
    assert found.status == "failed"
    assert found.error.startswith("printer: out of ink")
    assert ("layers 0 to 3" in found.error) is not runs
    monkeypatch.setattr("inkloop_lab.sweep.task.print_part", _full)
    with pytest.raises(ResultError, match="print 00000-0000: the disk is full"):
        perform(order, Task(0, 0, 5, {}))


def _full(*_: object, **__: object) -> None:
    raise OSError(28, "No space left on device")

"""Every shipped scenario prints, and the cylinder keeps its promises on average."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tools.figures import gallery
from tools.figures.pages import read_json

from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M
from support import prints
from support.benches.bench_run import FMUS, assert_same_print, emulated
from support.long_proofs import rest_is_long
from support.places import SCENARIOS as FOLDER
from support.prints import overrides_of

SCENARIOS = sorted(FOLDER.glob("*.toml"))
WHOLE = (
    *("bench", "cuboid", "cylinder", "cylinder-40", "cylinder-open-loop", "noisy-sensor", "roller", "staircase"),
    *("two-ink-3mf", "two-materials"),
)
"""Scenarios that `make test` prints to their end; the others begin there and end in `make test-long`."""
OTHERS = [path.stem for path in SCENARIOS if path.stem not in WHOLE]
SEEDS = pytest.mark.parametrize("seeds", rest_is_long([range(1, 2), range(1, 11)], 1), ids=["one", "ten"])


def printed(name: str, seed: int, variant: str = "", *, as_shipped: bool = False) -> Result:
    """A print of a scenario, printed once for all tests."""
    overrides = (("seed", seed),) if as_shipped else overrides_of(name, seed)
    return (
        printed_on_bench(name, dict(overrides))
        if name == "bench"
        else prints.printed(name, *overrides, variant=variant)
    )


def printed_on_bench(name: str, overrides: Mapping[str, Any]) -> Result:
    """A print on the emulator."""
    path = FOLDER / f"{name}.toml"
    with emulated(path, overrides) as (_, channel):
        return print_part(Scenario.load(path, {**overrides, "bench.channel": channel}))


def mean_over(seeds: range, name: str, variant: str = "") -> dict[str, float]:
    """Mean over the seeds of each figure [um]."""
    metrics = [printed(name, seed, variant, as_shipped=len(seeds) > 1).metrics() for seed in seeds]
    return {
        key: float(np.mean([figures[key] for figures in metrics])) * UM_PER_M for key in ("mean_error", "mae", "std")
    }


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_scenario_names_what_to_look_at_and_every_variant_of_it_is_one(path: Path) -> None:
    comment = [line for line in path.read_text().split("title =")[0].splitlines() if line]
    assert comment
    assert all(line.startswith("#") for line in comment)
    assert "What to look at:" in " ".join(comment)
    scenario = Scenario.load(path)
    for variant in scenario.tables.compare:  # those that no test prints, too
        assert scenario.variant(variant).job().nx == scenario.job().nx


@pytest.mark.parametrize("name", OTHERS)
def test_scenario_begins_to_print(name: str) -> None:
    scenario = Scenario.load(FOLDER / f"{name}.toml", {"run.layers_max": 2, **dict(overrides_of(name, 1))})
    result = print_part(scenario)
    assert result.dataset.sizes["layer"] == 3
    assert float(result.dataset.height[2].mean()) > float(result.dataset.height[0].mean())


@pytest.mark.parametrize("name", [*WHOLE, *(pytest.param(name, marks=pytest.mark.long) for name in OTHERS)])
def test_scenario_prints_until_its_controller_is_done(name: str) -> None:
    result = printed(name, seed=1)
    assert result.stop_reason == "done"
    assert result.dataset.sizes["layer"] > 1
    assert np.isfinite(result.dataset.height).all()


@SEEDS
@pytest.mark.parametrize(("name", "mae", "std"), [("cylinder", 0.45, 0.60), ("cylinder-40", 0.60, 0.76)])
def test_cylinder_ends_flat_and_on_target(name: str, mae: float, std: float, seeds: range) -> None:
    figures = mean_over(seeds, name)
    assert abs(figures["mean_error"]) <= 0.2
    assert figures["mae"] <= mae
    assert figures["std"] <= std


@SEEDS
@pytest.mark.parametrize(("name", "expected"), [("cylinder", 44.0), ("cylinder-40", 84.0)])
def test_open_loop_cylinder_ends_as_low_as_in_the_paper(name: str, expected: float, seeds: range) -> None:
    """Lu et al. 2015, Fig. 11 and 12: mean error 44.1 and 84.7 um."""
    assert mean_over(seeds, name, "open loop")["mean_error"] == pytest.approx(expected, abs=2.0)


def test_open_loop_scenario_is_the_open_loop_of_the_cylinder() -> None:
    alone, compared = printed("cylinder-open-loop", 1), printed("cylinder", 1, "open loop")
    np.testing.assert_array_equal(alone.final_height, compared.final_height)


@SEEDS
def test_cylinder_beats_the_papers_algorithm_on_the_same_plant(seeds: range) -> None:
    ours, theirs = mean_over(seeds, "cylinder"), mean_over(seeds, "cylinder", "paper's algorithm, same plant")
    assert ours["mae"] < theirs["mae"]


def test_two_inks_stay_where_the_part_puts_them() -> None:
    """Cells as wide as these leave a tenth of the walls to the wrong ink, with any controller."""
    closed, blind = printed("two-materials", 1).metrics(), printed("two-materials", 1, "open loop").metrics()
    assert closed["mismatch"] < 0.11
    assert blind["mismatch"] > 0.5
    assert abs(closed["mean_error"]) * UM_PER_M < 0.3


def test_noise_of_the_sensor_is_filtered_out() -> None:
    """With an exact sensor it is the cylinder."""
    filtered, exact = printed("noisy-sensor", 1).metrics(), printed("cylinder", 1).metrics()
    assert abs(filtered["mean_error"]) < 0.3e-6
    assert filtered["std"] < 1.3 * exact["std"]


def test_roller_reaches_the_height_for_more_ink_and_leaves_the_rim_low() -> None:
    rolled, closed = printed("roller", 1), printed("cylinder", 1)  # as the variant "closed loop, no roller"
    lacking = rolled.dataset.target_height.values - rolled.final_height.values
    i, j = np.meshgrid(np.arange(35) - 17, np.arange(35) - 17, indexing="ij")
    assert lacking[np.hypot(i, j) <= 15].min() > -1e-12
    assert lacking[np.hypot(i, j) <= 12].max() < 1e-6
    assert lacking[np.hypot(i, j) <= 15].max() > 10e-6
    assert rolled.metrics()["mae"] < printed("roller", 1, "open loop, no roller").metrics()["mae"] / 20
    assert rolled.metrics()["droplets"] > 1.05 * closed.metrics()["droplets"]
    assert closed.metrics()["std"] < rolled.metrics()["std"] / 3


@pytest.mark.long
def test_four_passes_weave_the_middle_and_lift_the_rim() -> None:
    """The same droplets, 8 cells around the middle and the ring outside 13 cells."""
    four, one = printed("four-passes", 1, "open loop"), printed("four-passes", 1, "open loop, one pass")
    assert four.metrics()["droplets"] == one.metrics()["droplets"]
    i, j = np.meshgrid(np.arange(35) - 17, np.arange(35) - 17, indexing="ij")
    middle, ring = np.hypot(i, j) <= 8, (np.hypot(i, j) > 13) & (np.hypot(i, j) <= 15)
    four_top, one_top = four.final_height.values, one.final_height.values
    assert four_top[middle].std() > 2 * one_top[middle].std()
    assert four_top[ring].mean() > one_top[ring].mean() + 1e-6
    assert abs(printed("four-passes", 1).metrics()["mean_error"]) < 0.3e-6
    assert printed("four-passes", 1).final_height.values[middle].std() < four_top[middle].std() / 2


@pytest.mark.long
def test_smaller_drops_make_an_evener_top_and_more_of_them_at_once_fewer_layers() -> None:
    grey, single = printed("grey-head", 1).metrics(), printed("grey-head", 1, "single drops").metrics()
    assert abs(grey["mean_error"]) < 0.3e-6
    assert max(grey["std"], single["std"]) < 0.6 * printed("cylinder", 1).metrics()["std"]
    assert single["layers"] > 2 * grey["layers"]


@pytest.mark.long
def test_uneven_substrate_is_not_seen_at_the_top() -> None:
    uneven, flat = printed("uneven-start", 1), printed("cylinder", 1)
    assert float(uneven.dataset.height[0].std()) > 10e-6
    assert uneven.metrics()["std"] < 1.1 * flat.metrics()["std"]
    assert printed("uneven-start", 1, "open loop").metrics()["std"] > 10e-6


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "mean", "std", "ratio", "times"),
    [
        ("no-flow", 0.5, 1.2, 3.0, 4.0),
        ("wide-droplets", 0.2, 0.6, 5.0, 4.0),
        ("wu-chiu-plant", 1.0, 2.2, 1.6, 3.5),  # seeds 1 to 6: 3.6 to 4.4 times, with the true surface as estimate
    ],
)
def test_controller_prints_on_plants_that_it_does_not_plan_with(
    name: str, mean: float, std: float, ratio: float, times: float
) -> None:
    closed, blind = printed(name, 1).metrics(), printed(name, 1, "open loop").metrics()
    assert abs(closed["mean_error"]) * UM_PER_M <= mean
    assert closed["std"] * UM_PER_M <= std
    assert blind["std"] > ratio * closed["std"]
    assert blind["mae"] > times * closed["mae"]


@pytest.mark.long
def test_scans_show_how_much_of_a_wide_droplet_arrives() -> None:
    adapted, kept = printed("wide-droplets", 1), printed("wide-droplets", 1, "ink not adapted")
    assert kept.metrics()["mean_error"] * UM_PER_M > 0.7 > 5 * abs(adapted.metrics()["mean_error"]) * UM_PER_M


def test_every_step_of_the_staircase_ends_at_its_height() -> None:
    run = printed("staircase", 1).dataset
    for top in (40e-6, 80e-6, 120e-6, 160e-6, 200e-6):
        step = np.isclose(run.target_height.values, top, rtol=1e-6, atol=0.0)
        assert step.any()
        assert float(run.height[-1].values[step].mean()) == pytest.approx(top, abs=2e-6)


@pytest.mark.long
def test_error_of_the_closed_loop_does_not_grow_with_the_height() -> None:
    tall, cylinder = printed("tall-cylinder", 1).metrics(), printed("cylinder", 1).metrics()
    assert tall["mae"] < 1.2 * cylinder["mae"]
    blind = [printed(name, 1, "open loop").metrics()["mean_error"] for name in ("cylinder", "tall-cylinder")]
    assert blind[1] > 2 * blind[0]


@pytest.mark.long
def test_bench_prints_what_the_fmus_print_to_the_bit() -> None:
    """As the smaller blocks of the tests of adapters and of interruptions, in four passes and many more frames."""
    fmus = print_part(Scenario.load(FOLDER / "bench.toml", {**FMUS, "seed": 1}))
    assert_same_print(printed("bench", 1, as_shipped=True), fmus)


@pytest.mark.long
@pytest.mark.parametrize(("name", "variant"), [("noisy-sensor", "exact sensor"), ("roller", "closed loop, no roller")])
def test_variant_is_the_print_of_the_cylinder(name: str, variant: str) -> None:
    ours, cylinder = (printed(*which, as_shipped=True) for which in ((name, 1, variant), ("cylinder", 1)))
    np.testing.assert_array_equal(ours.final_height, cylinder.final_height)


CHEAP = sorted(path.stem for path in SCENARIOS if path.stem not in ("bench", "pipe-junction"))


@pytest.mark.long
@pytest.mark.parametrize("name", CHEAP)
def test_record_of_the_gallery_is_what_the_scenario_prints(name: str) -> None:
    """Else its picture and its page show earlier runs: `make figures NAMES=gallery/NAME`."""
    recorded = read_json(gallery.RECORD)[name]
    others = Scenario.load(FOLDER / f"{name}.toml").tables.compare
    fresh = [printed(name, recorded["seed"], variant, as_shipped=True) for variant in ("", *others)]
    runs = {run.dataset.attrs["label"]: run for run in fresh}
    assert gallery.measured(runs) == recorded

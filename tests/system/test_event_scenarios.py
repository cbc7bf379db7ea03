"""Promises of the scenarios with failures, and of one with a sensor that goes blind in places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from inkloop.printing.run import print_part
from inkloop.results.result import Result
from inkloop.scenario.file import Scenario
from inkloop.units import UM_PER_M
from support import prints
from support.long_proofs import rest_is_long
from support.places import SCENARIOS
from support.prints import overrides_of

FOLDER = SCENARIOS
SEEDS = (1, 2, 3)
EVERY_SEED = pytest.mark.parametrize("seed", rest_is_long(SEEDS, 1))


def printed(name: str, seed: int, variant: str = "") -> Result:
    return prints.printed(name, *overrides_of(name, seed), variant=variant)


def groove(result: Result, layer: int) -> float:
    """Height of the lines of nozzles 5 and 12 of 16 below the others [um], away from the rim."""
    surface = result.dataset["height"].values[layer, 10:25]
    lines = np.arange(surface.shape[1])
    inner, dead = (lines >= 5) & (lines < 30), np.isin(lines % 16, [5, 12])
    return float(surface[:, inner & ~dead].mean() - surface[:, inner & dead].mean()) * UM_PER_M


def slope_x(surface: np.ndarray, mask: np.ndarray) -> float:
    """Slope of the plane through the cells of the part, along x, in um per cell."""
    i, j = np.nonzero(mask)
    plane = np.column_stack([i, j, np.ones_like(i)])
    return float(np.linalg.lstsq(plane, surface[mask], rcond=None)[0][0]) * UM_PER_M


@EVERY_SEED
def test_dead_nozzles_leave_grooves_that_only_the_closed_loop_fills(seed: int) -> None:
    closed, blind = printed("dead-nozzles", seed), printed("dead-nozzles", seed, "open loop")
    assert groove(closed, 9) == pytest.approx(0.0, abs=1.0)
    assert groove(closed, 29) > 50.0
    assert groove(closed, -1) == pytest.approx(0.0, abs=1.0)
    assert groove(blind, -1) > 20.0
    assert closed.metrics()["std"] * UM_PER_M <= 1.5
    assert np.flatnonzero(closed.dataset["modified"]).tolist() == list(range(10, 30))


@EVERY_SEED
def test_part_next_to_a_nozzle_that_stays_dead_ends_flat_and_the_print_ends(seed: int) -> None:
    result = printed("nozzle-stays-dead", seed)
    mask = result.dataset["mask"].values.astype(bool)
    alive = mask & (np.arange(mask.shape[1]) % 16 != 5)
    lacking = (result.dataset["target_height"].values - result.final_height.values) * UM_PER_M
    assert result.stop_reason == "done"
    assert result.dataset["dead_cells"].values[-1] == (mask & ~alive).sum()
    assert lacking[mask & ~alive].mean() > 100.0
    assert abs(lacking[alive].mean()) <= 0.3
    assert lacking[alive].std() <= 0.8


@EVERY_SEED
def test_print_with_fading_ink_ends_on_target_where_the_loop_is_closed(seed: int) -> None:
    assert abs(printed("drifting-ink", seed).metrics()["mean_error"]) * UM_PER_M <= 0.5  # ten seeds: 0.34, sd 0.05
    assert printed("drifting-ink", seed).metrics()["std"] * UM_PER_M <= 1.2
    assert printed("drifting-ink", seed, "open loop").metrics()["mean_error"] * UM_PER_M > 70.0


@EVERY_SEED
def test_controller_that_adapts_follows_the_ink_at_a_distance(seed: int) -> None:
    adapted = printed("drifting-ink", seed)
    fixed = prints.printed(
        "drifting-ink", *overrides_of("drifting-ink", seed), ("components.controller.adapt_ink", "off")
    )
    assert abs(adapted.metrics()["mean_error"]) < abs(fixed.metrics()["mean_error"])
    estimate = adapted.dataset["volume_scale"].values
    mean_volume = 0.9  # of 1 - U[0, 0.2]
    assert estimate[10] == pytest.approx(mean_volume, abs=0.01)
    assert mean_volume * (1 - 0.005 * 50) < estimate[60] < mean_volume * (1 - 0.005 * 20)
    assert (estimate[18:60] < estimate[15:57]).all()  # three layers later: single steps rise now and then


@EVERY_SEED
def test_tilted_substrate_shows_in_the_top_of_the_open_loop_only(seed: int) -> None:
    closed, blind = printed("tilted-substrate", seed), printed("tilted-substrate", seed, "open loop")
    mask = closed.dataset["mask"].values
    tilt = 0.004 * 263.256
    assert slope_x(closed.dataset["height"].values[0], mask) == pytest.approx(tilt, rel=1e-6, abs=0.0)
    assert 0.8 * tilt < slope_x(blind.final_height.values, mask) < tilt
    assert slope_x(closed.final_height.values, mask) == pytest.approx(0.0, abs=0.03)
    assert closed.metrics()["std"] * UM_PER_M <= 1.5


@EVERY_SEED
def test_print_continues_over_cells_that_the_sensor_loses(seed: int, tmp_path: Path) -> None:
    """The sensor marks a block of 5 x 5 cells as not valid, and gives rubbish there, in layers 10 to 29."""
    block = ", ".join(f"[{i}, {j}]" for i in range(15, 20) for j in range(15, 20))
    lost = "".join(
        f'\n[[events]]\nat_layer = 10\naction = "override"\nport = "profiler.{port}"\n{value}\ncells = [{block}]\n'
        f'\n[[events]]\nat_layer = 30\naction = "reset"\nport = "profiler.{port}"\n'
        for port, value in (("valid", "value = false"), ("measured_height", "value_um = 900"))
    )
    path = tmp_path / "blind.toml"
    path.write_text((FOLDER / "cylinder.toml").read_text() + lost)
    result = print_part(Scenario.load(path, {"seed": seed, "components.controller.horizon": 3}))
    valid = result.dataset["valid"].values
    assert [int((~valid[layer]).sum()) for layer in (9, 10, 29, 30)] == [0, 25, 25, 0]
    assert result.stop_reason == "done"
    assert result.metrics()["std"] * UM_PER_M <= 1.6

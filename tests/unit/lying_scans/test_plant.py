"""The printer of the rig: its layer map by hand, volumes, where droplets land."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from support.lying_scans.places import spread
from support.lying_scans.plant import CAP, LU, WIDE, Plant, deposit, printed, substrate

OBLONG = (9, 14)
EXACT = Plant(variation=0.0)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def rough(shape: tuple[int, int] = OBLONG) -> Any:
    return 20.0 * rng().random(shape)


@pytest.mark.parametrize(("droplet", "volume"), [(LU, 7.6), (WIDE, 7.6), (CAP, 4.256)], ids=["Lu", "wide", "cap"])
@pytest.mark.parametrize("is_flat", [True, False])
def test_droplet_adds_its_volume(droplet: Any, volume: float, is_flat: bool) -> None:
    surface, drops = np.zeros(OBLONG) if is_flat else rough(), np.zeros(OBLONG)
    drops[4, 5] = 0.9
    assert (deposit(surface, drops, droplet) - surface).sum() == pytest.approx(0.9 * volume, rel=1e-9, abs=0.0)


def test_first_layer_of_a_line_is_lower_at_its_ends() -> None:
    """Without corners each cell has h1, and h2 of each neighbour in the line."""
    drops = np.zeros((9, 5))
    drops[2:7, 2] = 1.0
    line = deposit(np.zeros((9, 5)), drops, {(0, 0): 4.0, (1, 0): 0.5, (1, 1): 0.0})
    assert line[2:7, 2].tolist() == [4.5, 5.0, 5.0, 5.0, 4.5]
    assert line[:, 1].tolist() == line[:, 3].tolist() == [0.0, 0.0, *5 * [0.5], 0.0, 0.0]
    assert line[[1, 7], 2].tolist() == [0.5, 0.5]


def test_neighbour_that_is_higher_takes_less_of_a_droplet() -> None:
    """By hand: 2 um higher, s = 1 - 2 / (4 + 1) = 0.6; 5 um higher, nothing; what is not taken stays."""
    surface, drops = np.zeros((5, 5)), np.zeros((5, 5))
    surface[1, 2], surface[2, 3], drops[2, 2] = 2.0, 5.0, 1.0
    after = deposit(surface, drops, {(0, 0): 4.0, (1, 0): 1.0, (1, 1): 0.0})
    assert after[1, 2] == pytest.approx(2.6, rel=1e-9, abs=0.0)
    assert after[2, 3] == 5.0
    assert after[3, 2] == after[2, 1] == 1.0
    assert after[2, 2] == pytest.approx(4.0 + 0.4 + 1.0, abs=1e-9)
    stays = deposit(surface, drops, {(0, 0): 4.0, (1, 0): 1.0, (1, 1): 0.0}, flows=False)
    assert (stays - surface)[2].tolist() == [0.0, 1.0, 4.0, 1.0, 0.0]


def test_share_beyond_the_grid_is_lost() -> None:
    drops = np.zeros((3, 3))
    drops[0, 0] = 1.0
    assert deposit(np.full((3, 3), 9.0), drops).sum() == pytest.approx(81.0 + 4.4 + 2 * 0.6 + 0.2, abs=1e-9)


@pytest.mark.parametrize("foreign", [{"satellites": 1.0}, {"placement": (0.3, -0.6)}, {"bleeding": 0.15}], ids=str)
def test_foreign_droplets_keep_their_volume(foreign: dict[str, Any]) -> None:
    drops = np.zeros((21, 19))
    drops[6:14, 6:12] = 1.0
    surface = 30.0 * drops
    after = printed(replace(EXACT, **foreign), surface, drops, 1, 0.0, rng())
    assert (after - surface).sum() == pytest.approx(48 * 7.6, rel=1e-9, abs=0.0)
    assert not np.allclose(after, deposit(surface, drops), rtol=0.0, atol=1e-9)


def test_droplets_land_where_placement_says() -> None:
    drops = np.zeros(OBLONG)
    drops[4, 5] = 1.0
    after = printed(replace(EXACT, placement=(1.0, -2.0)), np.zeros(OBLONG), drops, 1, 0.0, rng())
    assert np.unravel_index(after.argmax(), OBLONG) == (5, 3)


def test_volume_falls_and_differs_as_told() -> None:
    everywhere = np.ones((7, 5))
    bare = np.zeros((7, 5))
    half = printed(replace(EXACT, volume_loss=0.3), bare, everywhere, 9, 0.5, rng())
    assert half == pytest.approx(0.85 * deposit(bare, everywhere), rel=1e-9, abs=0.0)
    sides = printed(replace(EXACT, volume_right=0.2, flows=False), bare, everywhere, 1, 0.0, rng())
    assert sides[1, 2] / sides[5, 2] == pytest.approx(0.9 / 1.1, abs=1e-9)


def test_dry_rows_print_nothing_from_their_layer_on() -> None:
    plant, drops = (
        replace(EXACT, dry_rows=(3, 3), dry_from=5, droplet={(0, 0): 4.0, (1, 0): 0.0, (1, 1): 0.0}),
        np.ones(OBLONG),
    )
    before, after = (printed(plant, np.zeros(OBLONG), drops, layer, 0.0, rng()) for layer in (4, 5))
    assert (before == 4.0).all()
    assert (after[3] == 0.0).all()
    assert (np.delete(after, 3, 0) == 4.0).all()


def test_substrate_bows_to_its_corners() -> None:
    bowed = substrate(replace(EXACT, bow=10.0), (9, 9), 0.5)
    assert (bowed[4, 4], bowed[0, 0], bowed[0, 4]) == (0.0, 5.0, 2.5)


def test_amounts_spread_over_four_cells() -> None:
    amounts = np.zeros((4, 4))
    amounts[1, 1] = 1.0
    i, j = np.indices((4, 4), np.float64)
    landed = spread(amounts, i + 0.25, j - 1.5)
    assert landed[:, 0].tolist() == [0.0, 0.375, 0.125, 0.0]
    assert landed.sum() == 0.5

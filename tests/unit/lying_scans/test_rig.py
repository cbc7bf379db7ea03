"""The rig of prints whose scans lie: printer and profiler by hand, how prints end, what the benchmark says of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from benchmarks import lying_scans

from support.lying_scans.case import Case, Must
from support.lying_scans.cases import CASES
from support.lying_scans.parts import PARTS, job_of
from support.lying_scans.plant import CAP, LU, WIDE, Plant, deposit, printed, substrate
from support.lying_scans.profiler import TURNS, Profiler, displaced, read, shown
from support.lying_scans.rig import DONE, STOPPED, UNENDED, Outcome, print_case, print_cases

OBLONG = (9, 14)
EXACT = Plant(variation=0.0)
DRY = {(0, 0): 4.0, (1, 0): 0.0, (1, 1): 0.0}


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def rough(shape: tuple[int, int] = OBLONG) -> Any:
    return 20.0 * rng().random(shape)


def moved(surface: Any, **faults: Any) -> Any:
    return displaced(Profiler(**faults), surface, 0.0, rng())


@pytest.mark.parametrize(("droplet", "volume"), [(LU, 7.6), (WIDE, 7.6), (CAP, 4.256)], ids=["Lu", "wide", "cap"])
def test_droplet_adds_its_volume(droplet: Any, volume: float) -> None:
    surface, drops = rough(), np.zeros(OBLONG)
    drops[4, 5] = 0.9
    assert (deposit(surface, drops, droplet) - surface).sum() == pytest.approx(0.9 * volume, rel=1e-9, abs=0.0)


def test_neighbour_that_is_higher_takes_less_of_a_droplet() -> None:
    """By hand: 2 um higher, s = 1 - 2 / (4 + 1) = 0.6; 5 um higher, nothing; what is not taken stays."""
    surface, drops = np.zeros((5, 5)), np.zeros((5, 5))
    surface[1, 2], surface[2, 3], drops[2, 2] = 2.0, 5.0, 1.0
    line = {(0, 0): 4.0, (1, 0): 1.0, (1, 1): 0.0}
    after = deposit(surface, drops, line)
    assert after[1, 2] == pytest.approx(2.6, rel=1e-9, abs=0.0)
    assert after[2, 3] == 5.0
    assert after[3, 2] == after[2, 1] == 1.0
    assert after[2, 2] == pytest.approx(4.0 + 0.4 + 1.0, abs=1e-9)
    assert (deposit(surface, drops, line, flows=False) - surface)[2].tolist() == [0.0, 1.0, 4.0, 1.0, 0.0]
    drops = np.zeros((3, 3))
    drops[0, 0] = 1.0  # its share beyond the grid is lost
    assert deposit(np.full((3, 3), 9.0), drops).sum() == pytest.approx(81.0 + 4.4 + 2 * 0.6 + 0.2, abs=1e-9)


@pytest.mark.parametrize("foreign", [{"satellites": 1.0}, {"placement": (0.3, -0.6)}, {"bleeding": 0.15}], ids=str)
def test_foreign_droplets_keep_their_volume(foreign: dict[str, Any]) -> None:
    drops = np.zeros((21, 19))
    drops[6:14, 6:12] = 1.0
    surface = 30.0 * drops
    after = printed(replace(EXACT, **foreign), surface, drops, 1, 0.0, rng())
    assert (after - surface).sum() == pytest.approx(48 * 7.6, rel=1e-9, abs=0.0)
    assert not np.allclose(after, deposit(surface, drops), rtol=0.0, atol=1e-9)


def test_droplets_land_fall_short_and_dry_up_as_told() -> None:
    bare, everywhere, one = np.zeros(OBLONG), np.ones(OBLONG), np.zeros(OBLONG)
    one[4, 5] = 1.0
    after = printed(replace(EXACT, placement=(1.0, -2.0)), bare, one, 1, 0.0, rng())
    assert np.unravel_index(after.argmax(), OBLONG) == (5, 3)
    half = printed(replace(EXACT, volume_loss=0.3), bare, everywhere, 9, 0.5, rng())
    assert half == pytest.approx(0.85 * deposit(bare, everywhere), rel=1e-9, abs=0.0)
    sides = printed(replace(EXACT, volume_right=0.2, flows=False), np.zeros((7, 5)), np.ones((7, 5)), 1, 0.0, rng())
    assert sides[1, 2] / sides[5, 2] == pytest.approx(0.9 / 1.1, abs=1e-9)
    dry = replace(EXACT, dry_rows=(3, 3), dry_from=5, droplet=DRY)
    before, later = (printed(dry, bare, everywhere, layer, 0.0, rng()) for layer in (4, 5))
    assert (before == 4.0).all()
    assert (later[3] == 0.0).all()
    assert (np.delete(later, 3, 0) == 4.0).all()
    bowed = substrate(replace(EXACT, bow=10.0), (9, 9), 0.5)
    assert (bowed[4, 4], bowed[0, 0], bowed[0, 4]) == (0.0, 5.0, 2.5)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("cells", [1, -2])
def test_shift_reads_further_along_its_axis(axis: int, cells: int) -> None:
    """The reading of cell i is the surface at i + shift; beyond the grid its border goes on. A drift ends at -cells."""
    surface = rough()
    places = np.clip(np.arange(OBLONG[axis]) + cells, 0, OBLONG[axis] - 1)
    shift = (float(cells), 0.0) if axis == 0 else (0.0, float(cells))
    found = moved(surface, shift=shift)
    assert found == pytest.approx(np.take(surface, places, axis), abs=1e-9)
    drift = (-2.0 * shift[0], -2.0 * shift[1])
    back = displaced(Profiler(shift=shift, drift=drift), surface, 1.0, rng())
    assert back == pytest.approx(moved(surface, shift=(-shift[0], -shift[1])), abs=1e-9)


def test_rotation_magnification_and_shear_read_where_they_say() -> None:
    """Cell (i, j) reads the surface at the place turned from x to y, so the picture turns the other way."""
    surface = rough((9, 9))
    assert moved(surface, rotation=90.0) == pytest.approx(np.rot90(surface, -1), abs=1e-9)
    i, j = np.indices((11, 7), np.float64)
    assert moved(i, magnification=-0.2) == pytest.approx(5.0 + 0.8 * (i - 5.0), abs=1e-9)
    assert moved(j, magnification=-0.2) == pytest.approx(3.0 + 0.8 * (j - 3.0), abs=1e-9)
    assert moved(i, shear=0.1)[3:8] == pytest.approx((i + 0.1 * (j - 3.0))[3:8], abs=1e-9)
    assert moved(j, shear=0.1) == pytest.approx(j, abs=1e-9)


def test_readings_are_blurred_rounded_missing_and_spiked_as_told() -> None:
    point, wall = np.zeros((21, 21)), np.zeros((20, 20))
    point[10, 10], wall[:, 10:] = 1.0, 50.0
    wide = moved(point, spot=1.0)
    assert wide.sum() == pytest.approx(1.0, abs=1e-9)
    assert wide[10, 11] / wide[10, 10] == pytest.approx(np.exp(-0.5), abs=1e-9)
    assert (read(Profiler(noise=2.0, step=0.5), rough(), 0, 0.0, rng())[0] % 0.5 == 0.0).all()
    jitter, _ = read(Profiler(jitter=1.0, jitter_axis=1), np.zeros(OBLONG), 1, 0.0, rng())
    assert np.ptp(jitter, axis=0).max() == 0.0
    assert np.ptp(jitter) > 0.5
    spiked, _ = read(Profiler(spikes=0.05), wall, 0, 0.0, rng())
    i, j = np.nonzero(spiked != wall)
    assert (len(i), set(j)) == (20, {9, 10})
    assert set(np.abs(spiked - wall)[i, j]) == {20.0}
    _, valid = read(Profiler(walls_missing=12.0), wall, 0, 0.0, rng())
    assert ((~valid).nonzero()[1].min(), (~valid).sum()) == (9, 40)
    seen = [read(Profiler(missing_every=3), wall, layer, 0.0, rng())[1].all() for layer in range(6)]
    assert seen == [True, True, False, True, True, False]


@pytest.mark.parametrize(
    ("profiler", "expected"),
    [
        (Profiler(), [0.0, 1.0, 2.0, 3.0, 4.0]),
        (Profiler(frozen_from=3), [0.0, 1.0, 2.0, 2.0, 2.0]),
        (Profiler(late=2), [0.0, 0.0, 0.0, 1.0, 2.0]),
        (Profiler(zero=True), 5 * [0.0]),
    ],
)
def test_scans_lie_as_told(profiler: Profiler, expected: list[float]) -> None:
    scans = [(np.full((3, 3), float(layer)), np.ones((3, 3), np.bool_)) for layer in range(5)]
    assert [shown(profiler, scans[: layer + 1])[0][0, 0] for layer in range(5)] == expected


def test_orientations_are_the_seven_others_of_a_square() -> None:
    grid = np.arange(9.0).reshape(3, 3)
    assert len({grid.tobytes(), *(np.ascontiguousarray(turn(grid)).tobytes() for turn in TURNS.values())}) == 8
    letter = PARTS["letter F"](25, 25)
    assert all((turn(letter) != letter).any() for turn in TURNS.values())


def test_print_in_register_ends_flat_and_repeats() -> None:
    assert job_of("ellipse", (25, 25)).mask.sum() == 317  # a radius of ten cells
    case = CASES["in register, 20 %"]
    one, again = (print_case(case, 1) for _ in range(2))
    assert one.ending == DONE
    assert one.mae < 0.4
    assert (one.error == again.error).all()
    assert one.layers == next(iter(print_cases([case], 1))).layers


def test_print_that_commands_nothing_more_has_stopped() -> None:
    """Also one that is only cut off has not ended."""
    case = Case("empty", Must())

    class Silent:
        inputs = outputs = ()

        def initialize(self, time_ns: int, inputs: Any) -> Any:
            return {}

        def do_step(self, time_ns: int, step_ns: int, inputs: Any) -> Any:
            layer = int(inputs["layers_scanned"])
            pattern = np.full((25, 25), int(layer < 3), np.int32)
            return {"pattern": pattern, "drop_level": pattern, "layer_command": min(layer + 1, 3), "status": 4}

        def terminate(self) -> None:
            pass

    stopped = print_case(case, 1, lambda job: Silent())
    assert (stopped.ending, stopped.layers, stopped.untrusted_from) == (STOPPED, 3, 0)
    assert print_case(case, 1, lambda job: Silent(), layers_max=2).ending == UNENDED


def outcome(**fields: Any) -> Outcome:
    figures = {"mae": 0.3, "highest": 1.0, "lowest": -1.0, "layers": 14, "ending": DONE, "untrusted_from": None}
    return Outcome(
        **{"case": "", "seed": 1, "error": np.zeros((1, 1)), "reasons": 0, "outputs": {}, **figures, **fields}
    )


@pytest.mark.parametrize(
    ("must", "found", "missed"),
    [
        (Must(0.3, 2.0), {}, []),
        (Must(0.3, 2.0), {"mae": 0.304}, []),
        (Must(0.3, 2.0), {"mae": 0.61}, ["mae 2.0 x"]),
        (Must(lowest=-12.0), {"lowest": -30.0}, ["lowest 2.4 x"]),
        (Must(), {"ending": STOPPED}, ["does not end"]),
        (Must(stop_by=14), {"ending": STOPPED}, []),
        (Must(stop_by=13), {"ending": STOPPED}, ["stops late"]),
        (Must(stop_by=14), {}, ["does not stop"]),
        (Must(0.3, or_stops=True), {"mae": 9.0, "ending": STOPPED}, []),
        (Must(trusted=True), {"untrusted_from": 3}, ["not trusted"]),
        (Must(untrusted_by=5), {"untrusted_from": 6}, ["no warning in time"]),
        (Must(untrusted_by=5), {"untrusted_from": 5}, []),
        (Must(untrusted_by=5), {}, ["no warning in time"]),
    ],
)
def test_what_is_missed_is_said(must: Must, found: dict[str, Any], missed: list[str]) -> None:
    assert lying_scans.misses(Case("", must), [outcome(**found)]) == missed

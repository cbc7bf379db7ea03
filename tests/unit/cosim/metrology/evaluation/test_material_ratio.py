"""Parameters of the material ratio curve equal closed forms; volumes add up; turning the surface over swaps them."""

from __future__ import annotations

import numpy as np
import pytest

from support.evaluated import A, Map, areal, map_of, number, rough

SYMBOLS = ("Sk", "Spk", "Svk", "Smr1", "Smr2", "Vmp", "Vmc", "Vvc", "Vvv")


def of(heights: Map) -> dict[str, float]:
    """The parameters of heights whose places do not matter."""
    found = areal(map_of(heights.reshape(-1, 20)), f_operation="none")
    return {symbol: number(found, symbol) for symbol in SYMBOLS}


def shares(count: int) -> Map:
    return (np.arange(count) + 0.5) / count


def test_evenly_spread_heights_are_all_core() -> None:
    """c(p) = 1 - p: no peaks and no pits; volumes are triangles under it."""
    found = of(A * shares(2000))
    expected = {"Sk": A, "Vmp": A * 0.1**2 / 2, "Vmc": A * (0.8**2 - 0.1**2) / 2}
    expected |= {"Vvv": A * 0.2**2 / 2, "Vvc": A * (0.9**2 - 0.2**2) / 2}
    assert {symbol: found[symbol] for symbol in expected} == pytest.approx(expected, rel=1e-3, abs=0.0)
    assert max(found["Spk"], found["Svk"]) < 1e-3 * A
    assert (found["Smr1"], found["Smr2"]) == pytest.approx((0.0, 1.0), abs=1e-3)


def test_peaks_and_pits_on_a_core_have_their_triangles() -> None:
    """Straight pieces: 12 % of the cells rise to 3 A above a core that falls by A, 8 % lie down to 2 A below it."""
    p = shares(20_000)
    z = np.interp(p, [0.0, 0.12, 0.92, 1.0], [4.0 * A, A, 0.2 * A, -1.8 * A])
    found = of(z)
    expected = {"Sk": A, "Smr1": 0.12 * (1.0 - 0.12 / 3.0), "Smr2": 0.92 + 0.08 * 0.08 / 2.0}
    expected |= {"Spk": 4.0 * A - 1.12 * A, "Svk": 0.12 * A + 1.8 * A}  # from the core, drawn out to 0 and 100 %
    assert {symbol: found[symbol] for symbol in expected} == pytest.approx(expected, rel=1e-3, abs=0.0)


def test_volumes_add_up() -> None:
    """Above and below a height c, void less material is c less the mean height, which is zero."""
    z = rough((40, 30))
    found = of(z)
    z = z - z.mean()
    c10, c80 = np.quantile(z, [0.9, 0.2], method="hazen")
    assert found["Vvc"] + found["Vvv"] - found["Vmp"] == pytest.approx(c10, rel=1e-9, abs=0.0)
    assert found["Vvv"] - found["Vmp"] - found["Vmc"] == pytest.approx(c80, rel=1e-9, abs=0.0)
    over = np.clip(z, c80, c10).mean()  # the core alone: material from c80 to c10
    assert found["Vmc"] == pytest.approx(
        z[z > c80].sum() / z.size - found["Vmp"] - c80 * (z > c80).mean(), rel=1e-9, abs=0.0
    )
    assert found["Vvc"] == pytest.approx(c10 - over, rel=1e-9, abs=0.0)


def test_turning_the_surface_over_swaps_peaks_and_pits() -> None:
    one, other = of(rough((40, 30))), of(-rough((40, 30)))
    assert other["Sk"] == pytest.approx(one["Sk"], rel=1e-6, abs=0.0)
    assert (other["Spk"], other["Svk"]) == pytest.approx((one["Svk"], one["Spk"]), rel=1e-6, abs=0.0)
    assert (other["Smr1"], other["Smr2"]) == pytest.approx((1.0 - one["Smr2"], 1.0 - one["Smr1"]), rel=1e-6, abs=0.0)

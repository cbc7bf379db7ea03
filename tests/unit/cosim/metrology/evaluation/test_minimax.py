"""The minimax fit is the solution of the linear program over all points, and its zone touches where theory says."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog

from inkloop.metrology.evaluation.form import minimax


def of_all_points(terms: np.ndarray, values: np.ndarray) -> float:
    """Half width of the zone by one linear program over every point."""
    ones = np.ones((len(values), 1))
    solved = linprog(
        np.append(np.zeros(terms.shape[1]), 1.0),
        A_ub=np.block([[terms, -ones], [-terms, -ones]]),
        b_ub=np.concatenate([values, -values]),
        bounds=[(None, None)] * (terms.shape[1] + 1),
    )
    return float(solved.x[-1])


@pytest.mark.parametrize("kind", ["rough", "dome", "saddle", "waves", "few"])
def test_the_zone_is_that_of_the_linear_program(kind: str) -> None:
    rng = np.random.default_rng(7)
    x, y = rng.uniform(-1.0, 1.0, (2, 5 if kind == "few" else 1000))
    z = {
        "rough": rng.normal(size=x.size),
        "few": rng.normal(size=x.size),
        "dome": -x * x - y * y,
        "saddle": x * y,
        "waves": np.sin(9 * x) * np.cos(7 * y) + 0.4 * x**3,
    }[kind]
    terms = np.column_stack([np.ones_like(x), x, y])
    factors, half = minimax(terms, z + 3.0 * x - 50.0)
    assert half == pytest.approx(of_all_points(terms, z), rel=1e-6, abs=0.0)
    assert np.abs(z + 3.0 * x - 50.0 - terms @ factors).max() == pytest.approx(half, rel=1e-9, abs=0.0)


def test_a_parabola_has_its_chebyshev_line() -> None:
    """x^2 on [-1, 1]: the best constant and line is 1/2, the zone 1/2, in any unit and far from the origin."""
    x = np.linspace(-1.0, 1.0, 2001)
    terms = np.column_stack([np.ones_like(x), x * 1e-3])
    factors, half = minimax(terms, 1e-6 * x**2 + 1e-3)
    assert half == pytest.approx(0.5e-6, rel=1e-6, abs=0.0)
    assert factors == pytest.approx([1e-3 + 0.5e-6, 0.0], rel=1e-6, abs=1e-9)


def test_points_on_a_plane_have_no_zone() -> None:
    x, y = np.indices((5, 4)).reshape(2, -1) * 1e-5
    assert minimax(np.column_stack([np.ones_like(x), x, y]), 2.0 + 0.1 * x - 0.2 * y)[1] < 1e-14

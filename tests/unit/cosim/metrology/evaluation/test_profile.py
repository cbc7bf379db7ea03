"""Profile parameters on rows: closed forms, sections and evaluation length, gaps."""

from __future__ import annotations

from math import log, pi, sqrt, tan
from typing import Any

import numpy as np
import pytest

from inkloop.metrology.evaluation.definitions import Axis, Treatment
from inkloop.metrology.evaluation.profile import Profiles
from inkloop.metrology.evaluation.subject import Subject
from inkloop.metrology.evaluation.surface import Found
from inkloop.metrology.evaluation.table import found_on_profiles
from support.evaluated import PERIOD, STEP, A, Map, check, check_same, map_of, number, reason, rough, wave


def profiles(z: Map, axis: Axis = "x", mask: Map | None = None, **treatment: Any) -> tuple[Found, Profiles]:
    """Of pixels that are longer across the profiles."""
    steps = (STEP, 3 * STEP) if axis == "x" else (3 * STEP, STEP)
    values, evaluated = found_on_profiles(Subject(map_of(z, *steps), mask), axis, Treatment(**treatment))
    assert evaluated is not None
    return values, evaluated


def test_a_sinusoid_has_its_closed_forms() -> None:
    """Along the other axis the rows are level."""
    values, evaluated = profiles(wave(), f_operation="none")
    expected = {"Pa": 2 * A / (PERIOD * tan(pi / PERIOD)), "Pq": A / sqrt(2), "Pp": A, "Pv": A, "Pt": 2 * A}
    check(values, expected)
    assert (evaluated.count, evaluated.rows, evaluated.sections) == (11, 11, 0)
    assert evaluated.length == pytest.approx(2 * PERIOD * STEP, rel=1e-12, abs=0.0)
    level, _ = profiles(wave(), "y", f_operation="none")
    assert number(level, "Pt") == pytest.approx(0.0, abs=1e-18)


def test_roughness_is_what_the_filter_leaves_over_five_sections() -> None:
    """A wave of half the cutoff keeps 1 - 2^-4 of its amplitude; a wave of four times the cutoff 1 - 2^(-1/16)."""
    n = np.arange(800)
    cutoff = 2 * PERIOD * STEP
    for length in (PERIOD, 8 * PERIOD):
        z = np.repeat(A * np.sin(2 * pi * n / length)[:, None], 3, axis=1)
        values, evaluated = profiles(z, f_operation="none", l_filter=cutoff)
        kept = 1.0 - np.exp(-log(2) * (2 * PERIOD / length) ** 2)
        assert (evaluated.sections, evaluated.length) == (5, pytest.approx(5 * cutoff, rel=1e-12, abs=0.0))
        if length == PERIOD:
            expected = {"Rq": A / sqrt(2), "Rp": A, "Rv": A, "Rz": 2 * A, "Rt": 2 * A}
            check(values, {symbol: kept * value for symbol, value in expected.items()}, rel=2e-3)
        else:
            assert number(values, "Rt") == pytest.approx(2 * A * kept, rel=0.05, abs=0.0)


def test_sections_have_their_own_peaks() -> None:
    """One spike in one of five sections: Rp is a fifth of it, Rt all of it."""
    z = np.zeros((1000, 60))
    z[500] = A
    values, _ = profiles(z, f_operation="none", l_filter=200 * STEP, filter_order=0)
    check(values, {"Rt": A, "Rp": A / 5}, rel=0.02)


def elements(z: Map, peak: float, pit: float) -> list[float]:
    """Lengths of the profile elements, stated again as the text has it: walk, and note where hills and dales change."""
    crossings, side, first = [], 0, 0.0
    for k in range(z.size):
        if k and (z[k - 1] > 0.0) != (z[k] > 0.0):
            at = k - 1 + z[k - 1] / (z[k - 1] - z[k])
            first, last = (at if first < 0.0 else first), at
        now = 1 if z[k] > 0.1 * peak else -1 if z[k] < -0.1 * pit else 0
        if now and side and now != side:
            crossings.append((first + last) / 2.0)
        if now:
            side, first = now, -1.0
    return [end - begin for begin, end in zip(crossings, crossings[2:], strict=False)]


def test_shape_and_spacing_of_known_waves() -> None:
    """A rectangle of duty 1/4: Psk 2 / sqrt(3), Pku 7/3; a triangle: 0, 9/5; a sinusoid: 0, 3/2."""
    n = np.arange(4000) + 0.5
    saw = np.abs((n / PERIOD) % 1.0 - 0.5)
    for row, skewness, kurtosis in (
        (np.where((n / PERIOD) % 1.0 < 0.25, 1.0, 0.0), 2 / sqrt(3), 7 / 3),
        (saw, 0.0, 9 / 5),
        (np.sin(2 * pi * n / PERIOD), 0.0, 3 / 2),
    ):
        values, _ = profiles(np.repeat(A * row[:, None], 3, axis=1), f_operation="none")
        check(values, {"Psk": skewness, "Pku": kurtosis}, rel=5e-3, abs=1e-9)
        check(values, {"Psm": PERIOD * STEP}, rel=1e-9)


def test_ripples_below_a_tenth_of_the_peaks_are_no_elements() -> None:
    n = np.arange(4000) + 0.5
    small, large = (np.sin(2 * pi * n / PERIOD) + share * np.sin(2 * pi * n / 5) for share in (0.09, 0.5))
    for row, expected in ((small, PERIOD), (large, None)):
        values, _ = profiles(A * row[:, None] * np.ones(3), f_operation="none")
        length = number(values, "Psm") / STEP
        assert length == pytest.approx(PERIOD, rel=1e-3, abs=0.0) if expected else length < 0.5 * PERIOD
    period = np.repeat([1.0, -0.175, 0.05, -0.175], [5, 10, 5, 20])  # the ripple is below a tenth of the hills only
    values, _ = profiles(A * np.tile(period, 20)[:, None] * np.ones(3), f_operation="none")
    check(values, {"Psm": PERIOD * STEP}, rel=1e-9)


@pytest.mark.parametrize("l_filter", [None, 20 * STEP])
def test_a_profile_alone_is_evaluated_like_its_statement(l_filter: float | None) -> None:
    """One row of points; its line is taken off, for a plane needs two rows."""
    raw = rough((600, 1)) + 5e-7 * np.arange(600)[:, None]
    values, evaluated = profiles(raw, l_filter=l_filter)
    assert (evaluated.count, evaluated.rows) == (1, 1)
    x, z = np.arange(600.0), raw[:, 0]
    z, letter, sections = z - np.polyval(np.polyfit(x, z, 1), x), "P", 1
    if l_filter is not None:
        weights = np.exp(-pi * ((x[:, None] - x) / (sqrt(log(2) / pi) * 20)) ** 2) * (np.abs(x[:, None] - x) <= 20)
        line = [np.polyfit(x, z, 1, w=np.sqrt(row)) for row in weights]
        z = z - [np.polyval(fit, at) for fit, at in zip(line, x, strict=True)]
        z, letter, sections = (z - z.mean())[250:350], "R", 5
    parts = z.reshape(sections, -1)
    peak, pit, q = parts.max(axis=1).mean(), -parts.min(axis=1).mean(), np.sqrt(np.mean(z**2))
    expected = {"a": np.mean(np.abs(z)), "q": q, "p": peak, "v": pit, "t": np.ptp(z)}
    expected |= {"sk": np.mean(z**3) / q**3, "ku": np.mean(z**4) / q**4}
    expected["sm"] = float(np.mean(elements(z, peak, pit))) * STEP
    check(values, {letter + key: float(value) for key, value in expected.items()}, rel=1e-6)


def test_flat_profile_has_neither_shape_nor_spacing() -> None:
    values, _ = profiles(np.zeros((40, 3)))
    assert "a profile is flat" in reason(values, "Psk")
    assert "no profile has a hill and a dale" in reason(values, "Psm")


def test_rows_end_at_gaps_and_short_ones_are_left_out() -> None:
    """On a disc half of the rows hold the evaluation length; each is evaluated in its middle."""
    i, j = np.indices((61, 61)) - 30
    z, mask = 1e-9 * i.astype(float) ** 2, np.hypot(i, j) < 30
    values, evaluated = profiles(z, mask=mask, f_operation="none")
    cells = round(evaluated.length / STEP)
    half = (cells - 1) / 2
    assert 0.5 <= evaluated.count / evaluated.rows < 0.6
    assert str(evaluated).startswith(f"{evaluated.count} of {evaluated.rows} rows along x")
    assert number(values, "Pt") == pytest.approx(1e-9 * half**2, rel=0.1, abs=0.0)
    z = np.where(j == 5, np.nan, wave(61, 61))
    one, _ = profiles(z, "y", f_operation="none")
    for order in (1, -1):
        _, turned = profiles(z[:, ::order], "y", f_operation="none")
        assert (turned.count, turned.length) == (61, pytest.approx(35 * STEP, rel=1e-12, abs=0.0))
    assert number(one, "Pt") == pytest.approx(0.0, abs=1e-18)


def test_offset_mirror_and_transposition_change_nothing() -> None:
    z = rough((60, 40))
    filters: tuple[dict[str, Any], ...] = ({}, {"l_filter": 8 * STEP})
    for treatment in filters:
        values, _ = profiles(z, **treatment)
        check_same(profiles(z + 1e-4, **treatment)[0], values, rel=1e-7)
        check_same(profiles(z[::-1], **treatment)[0], values, rel=1e-7)
        check_same(profiles(z.T, "y", **treatment)[0], values, rel=1e-7)
        cut, mask = rough((60, 40)), np.zeros((60, 40), bool)
        mask[10:50, 5:30] = True
        check_same(profiles(cut[10:50, 5:30], **treatment)[0], profiles(cut, mask=mask, **treatment)[0], rel=1e-7)


def test_profiles_that_are_too_short_are_refused() -> None:
    values, evaluated = found_on_profiles(Subject(map_of(rough((9, 40)))), "x", Treatment())
    assert evaluated is None
    assert "less than 10 cells" in reason(values, "Pa")
    assert found_on_profiles(Subject(map_of(rough((10, 40)))), "x", Treatment())[1] is not None
    values, _ = found_on_profiles(Subject(map_of(rough((60, 40)))), "y", Treatment(l_filter=41 * STEP))
    assert "wider than the cells" in reason(values, "Rz")
    i, j = np.indices((60, 40))
    values, _ = found_on_profiles(
        Subject(map_of(np.where((i + j) % 12 == 0, np.nan, rough((60, 40))))), "y", Treatment(l_filter=30 * STEP)
    )
    assert "too few for an evaluation length" in reason(values, "Rz")


def test_profiles_say_how_many_rows_and_sections_they_are() -> None:
    subject = Subject(map_of(rough((60, 17))))
    _, whole = found_on_profiles(subject, "y")
    assert str(whole) == "60 of 60 rows along y, evaluation length 170 µm, primary profiles"
    _, sections = found_on_profiles(subject, "x", Treatment(l_filter=2e-4))
    _, thirds = found_on_profiles(subject, "x", Treatment(l_filter=3e-4))
    assert str(thirds) == "17 of 17 rows along x, evaluation length 600 µm, 2 section lengths"
    assert str(sections) == "17 of 17 rows along x, evaluation length 600 µm, 3 section lengths"

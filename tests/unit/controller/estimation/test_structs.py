"""What the estimator knows keeps the place of every number, in arrays for a checkpoint and in structures for C."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from inkloop.component import Ink
from inkloop_controller.estimation.height_estimator import Estimate, is_probe
from inkloop_controller.estimation.ink_identification import InkEvidence, InkKnowledge
from inkloop_controller.estimation.loop_trust import LoopTrust
from inkloop_controller.estimation.scan_registration import Registration

INKS = (Ink(4.4e-6, 0.6e-6, 0.2e-6), Ink(3.9e-6, 0.55e-6, 0.15e-6))


def trust() -> LoopTrust:
    numbers = {field.name: 3 + k if field.type == "int" else 0.5 + k for k, field in enumerate(fields(LoopTrust))}
    return LoopTrust(**{**numbers, "ground_wrong": True})  # type: ignore[arg-type]


def registration() -> Registration:
    numbers = iter(np.arange(1.0, 20.0))

    def some(*shape: int) -> Any:
        return np.array([next(numbers) for _ in range(int(np.prod(shape)))]).reshape(shape)

    rest: Any = (*(float(next(numbers)) for _ in range(4)), 23, False, True)
    return Registration(some(3), some(3, 3), some(3), *rest)


def evidence(shares: int, first: float) -> InkEvidence:
    square: Any = np.arange(float(shares**2)).reshape(shares, shares)
    line: Any = np.arange(float(shares))
    return InkEvidence(first + square, first + 100.0 + line, first + 200.0 + square)


def knowledge() -> InkKnowledge:
    return InkKnowledge(evidence(6, 1.0), evidence(2, 1000.0), np.array([5.5, 6.5]))


def estimate() -> Estimate:
    rng = np.random.default_rng(1)
    shape = (5, 3)
    maps: dict[str, Any] = {
        name: rng.normal(size=shape) for name in ("height", "height_variance", "dead_evidence", "reckoned")
    }
    whole = rng.random(shape) < 0.5
    learnt: dict[str, Any] = {"learnt": knowledge(), "registration": registration(), "trust": trust()}
    plain: dict[str, Any] = {"ink_scale": 0.875, "scans": 17, "noise_variance": 3e-14, "inks": INKS}
    flags: dict[str, Any] = {"untrusted": whole, "capped": ~whole, "unseen": rng.integers(0, 9, shape, np.int32)}
    return Estimate(**maps, **plain, **flags, **learnt, response=rng.normal(size=(3, *shape)))


def assert_same(found: Any, expected: Any) -> None:
    for field in fields(expected):
        one, other = getattr(found, field.name), getattr(expected, field.name)
        if isinstance(other, InkEvidence | InkKnowledge | LoopTrust | Registration):
            assert_same(one, other)
        else:
            np.testing.assert_array_equal(one, other, err_msg=field.name)
            assert type(one) is type(other), field.name


def test_structures_have_the_numbers_under_their_names() -> None:
    found, given = trust().struct(), trust()
    assert tuple(found.ground) == (given.ground_offset, given.ground_rise_x, given.ground_rise_y)
    for name, *_ in found._fields_[1:]:
        assert getattr(found, name) == getattr(given, name), name
    one, known = registration().struct(), registration()
    assert tuple(one.covariance) == tuple(known.covariance.ravel())
    for name, *_ in one._fields_:
        if name != "covariance":
            np.testing.assert_array_equal(np.array(getattr(one, name)), getattr(known, name), err_msg=name)
    learnt, all_ = knowledge().struct(), knowledge()
    np.testing.assert_array_equal(learnt.evidence.response, all_.evidence.response.ravel())
    np.testing.assert_array_equal(learnt.evidence.covariance, all_.evidence.covariance.ravel())
    np.testing.assert_array_equal(learnt.evidence.surplus, all_.evidence.surplus)
    np.testing.assert_array_equal(learnt.volumes.response[:5], [*all_.volumes.response.ravel(), 0.0])
    np.testing.assert_array_equal(learnt.volumes.surplus[:3], [*all_.volumes.surplus, 0.0])
    assert tuple(learnt.errors) == (5.5, 6.5)


def test_structures_come_back_as_they_were() -> None:
    assert_same(LoopTrust.of_struct(trust().struct()), trust())
    assert_same(Registration.of_struct(registration().struct()), registration())
    assert_same(InkKnowledge.of_struct(knowledge().struct(), 6, 2), knowledge())


def test_arrays_come_back_as_they_were() -> None:
    assert_same(LoopTrust.of_sums(trust().sums()), trust())
    assert_same(Registration.of_sums(registration().sums()), registration())
    assert_same(InkKnowledge.of_arrays(knowledge().arrays()), knowledge())
    assert_same(Estimate.of_arrays(estimate().arrays()), estimate())


def test_nothing_is_learnt_and_all_is_trusted_at_first() -> None:
    exact = Estimate.exact(np.ones((4, 3)), INKS)
    assert not exact.trust.reasons
    assert exact.trust.surprise == 1.0
    assert exact.learnt.evidence.response.shape == exact.learnt.volumes.response.shape == (2, 2)
    assert exact.response.shape == (3, 4, 3)
    assert not exact.registration.is_applied
    for nothing in (exact.dead, exact.capped, exact.untrusted, exact.height_variance, exact.unseen):
        assert not nothing.any()
    np.testing.assert_array_equal(exact.reckoned, exact.height)
    assert (exact.ink_scale, exact.scans, exact.noise_variance) == (1.0, 0, 0.0)


def test_cell_is_dead_from_the_evidence_of_fifteen_on_and_tried_again_every_five_layers() -> None:
    some = replace(estimate(), dead_evidence=np.array([[14.999, 15.0, 16.0]]))
    assert some.dead.tolist() == [[False, True, True]]
    assert [layer for layer in range(1, 16) if is_probe(layer)] == [5, 10, 15]


@pytest.mark.parametrize(("has_shift", "has_wide_spot"), [(True, False), (False, True), (False, False)])
def test_displacement_adds_to_the_variance_where_scans_are_corrected(has_shift: bool, has_wide_spot: bool) -> None:
    whole = estimate()
    known = replace(whole.registration, has_shift=has_shift, has_wide_spot=has_wide_spot)
    found = replace(whole, height_variance=whole.height_variance**2, registration=known)
    before = found.height_variance.copy()
    squares = max(ink.h1**2 + 4 * ink.h2**2 + 4 * ink.h3**2 for ink in INKS)
    expected = before + 0.01 * squares
    if has_shift or has_wide_spot:
        for i, j in np.ndindex(5, 3):
            row = whole.response[:, i, j]
            expected[i, j] += row @ known.covariance @ row
    np.testing.assert_allclose(found.predicted_variance, expected, rtol=1e-9, atol=0.0)
    np.testing.assert_array_equal(found.height_variance, before)

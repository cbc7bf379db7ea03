"""The known word that a message offers for an unknown one, and errors with a remedy of their own."""

from __future__ import annotations

from itertools import pairwise

import pytest

from inkloop.errors import InkloopError, near, nearest


@pytest.mark.parametrize(
    ("found", "known", "offered"),
    [
        ("nx", ["ny", "pitch_um"], ["ny"]),  # of short words half of the letters are enough
        ("min", ["mean"], ["mean"]),
        ("mint", ["mean"], []),
        ("alhpa", ["alpha", "beta"], ["alpha"]),
        ("horizn", ["horizons", "horizon"], ["horizon"]),  # both are alike, one of them is nearer
        ("x.b", ["x.c", "x.a"], ["x.a", "x.c"]),
        ("pitch", [], []),
    ],
)
def test_nearest_words_are_offered_and_none_where_nothing_is_alike(
    found: str, known: list[str], offered: list[str]
) -> None:
    assert near(found, known) == offered


def test_at_most_three_words_are_offered_else_all_are_listed() -> None:
    assert nearest("ax", ["a4", "a2", "a3", "a1"]) == "did you mean a1 or a2 or a3?"
    assert nearest("q", ["two", "one"]) == "known: one, two"
    assert nearest("q", ["two", "one"], ["b", "a"]) == "known: a, b"
    assert nearest("q", []) == "known: none"


class Said(InkloopError):
    has_own_remedy = True


def caused(*errors: Exception) -> InkloopError:
    """The first error, caused by the second, and so on."""
    for error, cause in pairwise(errors):
        error.__cause__ = cause
    assert isinstance(errors[0], InkloopError)
    return errors[0]


def test_remedy_is_said_by_an_error_or_by_any_inkloop_error_that_caused_it() -> None:
    assert caused(Said()).remedy_is_said
    assert caused(InkloopError(), InkloopError(), Said()).remedy_is_said
    assert not caused(InkloopError(), InkloopError()).remedy_is_said
    assert not caused(InkloopError(), ValueError(), Said()).remedy_is_said

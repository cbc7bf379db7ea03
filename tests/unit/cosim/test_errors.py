"""Errors as other programs get them."""

from __future__ import annotations

import pickle

from inkloop.errors import ScenarioError


def test_error_of_a_scenario_passes_between_processes() -> None:
    error = ScenarioError("part.toml", ["grid.nx is 0; needs at least 1", "ink is missing"])
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is ScenarioError
    assert str(error).splitlines() == ["part.toml: 2 errors", *(f"  - {one}" for one in error.errors)]
    assert str(ScenarioError("part.toml", error.errors[:1])).splitlines()[0] == "part.toml: 1 error"
    assert (copy.source, copy.errors, str(copy)) == (error.source, error.errors, str(error))

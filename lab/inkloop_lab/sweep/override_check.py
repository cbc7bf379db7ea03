"""Values of a study that no point could be printed with, found before the first print."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from inkloop.errors import ScenarioError
from inkloop.scenario.file import Scenario

TRIES = 50
"""Points that a value is tried with that does not fit the scenario as it stands."""


def errors_of_values(text: str, source: str, places: Mapping[str, str], keys: Mapping[str, Sequence[Any]]) -> list[str]:
    """A sentence for each value that fits neither the scenario nor the scenario with another key of the study changed.

    places: key -> where it stands in the study; keys: key -> its values. A value that fits with some other keys only is
    no error of the study: the points that it does not fit become rows with their error.
    """
    known = set(_errors(text, source, {}))
    found = []
    for key, values in keys.items():
        for value in values:
            errors = [error for error in _errors(text, source, {key: value}) if error not in known]
            if not errors or (not known and _fits_with_others(text, source, key, value, keys)):
                continue
            found += [f"{places[key]}: {error}" for error in errors]
    return list(dict.fromkeys(found))


def _fits_with_others(text: str, source: str, key: str, value: Any, keys: Mapping[str, Sequence[Any]]) -> bool:
    others = ({other: each} for other, values in keys.items() if other != key for each in values)
    return any(not _errors(text, source, {**other, key: value}) for other, _ in zip(others, range(TRIES), strict=False))


def _errors(text: str, source: str, overrides: Mapping[str, Any]) -> tuple[str, ...]:
    try:
        Scenario.of_text(text, source, overrides)
    except ScenarioError as error:
        return error.errors
    return ()

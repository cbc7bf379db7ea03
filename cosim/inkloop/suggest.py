"""Suggest the known words that are nearest to a misspelt one."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

OFFERED_MAX = 3  # more words than this are alike by chance
SHORT = 3  # letters of a word in which one wrong letter is already a third


def nearest(found: str, known: Iterable[str], listed: Iterable[str] | None = None) -> str:
    """Suggestion instead of `found`: the nearest known words that are equally near, else all, or `listed`."""
    words = sorted(known)
    if close := near(found, words):
        return f"did you mean {' or '.join(close[:OFFERED_MAX])}?"
    return f"known: {', '.join(words if listed is None else sorted(listed)) or 'none'}"


def near(found: str, known: Iterable[str]) -> list[str]:
    """The nearest known words, all that are equally near; none where nothing is alike."""
    words = sorted(known)
    alike = {word: difflib.SequenceMatcher(None, word, found).ratio() for word in words}
    limit = 0.5 if len(found) <= SHORT else 0.6
    return [word for word in words if alike[word] >= max(limit, *alike.values())]

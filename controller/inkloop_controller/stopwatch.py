"""Time by phase, and what is left of a limit."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import inf
from time import perf_counter


class Stopwatch:
    """Runs from its making; limit [s]."""

    def __init__(self, limit: float = inf) -> None:
        self._end = perf_counter() + limit
        self.seconds: dict[str, float] = {}

    @property
    def remaining(self) -> float:
        """What is left of the limit [s], not below 0."""
        return max(0.0, self._end - perf_counter())

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """What runs inside counts for the phase `name`."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + perf_counter() - begin

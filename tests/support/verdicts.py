"""Numbers of accepted inputs of a property, so that a reader that refuses everything, or nothing, is found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


class Verdicts:
    """Counts what was taken and what was refused."""

    def __init__(self) -> None:
        self.taken = self.refused = 0

    @contextmanager
    def count(self, refusal: type[Exception]) -> Iterator[None]:
        try:
            yield
        except refusal:
            self.refused += 1
        else:
            self.taken += 1

    def check(self, share: float) -> None:
        """At least this share of the inputs is taken, and some input is refused."""
        assert self.taken >= share * (self.taken + self.refused), vars(self)
        assert self.refused > 0, vars(self)

"""Number of examples of a property."""

from __future__ import annotations

import os

PERCENT = "INKLOOP_EXAMPLES_PERCENT"
"""Environment variable; `make check` and `make test` set it below 100, `make test-long` tries all."""


def examples(count: int) -> int:
    """`count`, or the share of it that the run asks for."""
    return max(1, count * int(os.environ.get(PERCENT, "100")) // 100)

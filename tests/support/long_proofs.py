"""Cases of which some run always and the others with `make test-long`."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest


def rest_is_long(cases: Iterable[Any], quick: int) -> list[Any]:
    """The first `quick` cases as they are, the others marked `long`."""
    return [
        case
        if number < quick
        else pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.long)
        for number, case in enumerate(cases)
    ]

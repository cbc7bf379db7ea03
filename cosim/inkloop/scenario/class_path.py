"""Search path for the classes that a scenario names as "module:Class"."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

__all__ = ["classes_from"]


@contextmanager
def classes_from(folder: Path) -> Iterator[None]:
    """Within the block a kind "module:Class" is also looked for in `folder`."""
    place = str(folder.resolve())
    if place in sys.path:
        yield
        return
    sys.path.append(place)
    try:
        yield
    finally:
        sys.path.remove(place)

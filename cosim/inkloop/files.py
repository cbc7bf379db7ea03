"""Files that are either there whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def replaced(path: Path, *, durable: bool = False) -> Iterator[Path]:
    """A temporary name in the same folder, renamed to `path` when the block ends well, removed when it fails.

    durable: when the block has ended well, not even a power failure takes the file back.
    """
    partial = path.with_name(f".{path.name}.part")
    try:
        yield partial
        if durable:
            with partial.open("rb+") as file:
                os.fsync(file.fileno())
        partial.replace(path)
        if durable:
            sync_folder(path.parent)
    finally:
        partial.unlink(missing_ok=True)


def sync_folder(folder: Path) -> None:
    """Have the disk know which files a folder holds; where folders cannot be synced (Windows) the system sees to it."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_text(path: Path, text: str, *, durable: bool = False) -> None:
    """Write a UTF-8 text whole or not at all; durable: see `replaced`."""
    with replaced(path, durable=durable) as partial:
        partial.write_text(text, encoding="utf-8")

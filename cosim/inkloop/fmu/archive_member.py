"""FMUs that stand in an .ssp: named `system.ssp/resources/plant.fmu`, as if that were a folder."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from inkloop.errors import FmuError
from inkloop.files import reason_of, temporary_folder
from inkloop.limits import unpacked_error

SUFFIX = ".ssp"
UNREADABLE = (OSError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Errors of reading a damaged or encrypted archive; NotImplementedError is a RuntimeError."""


@contextmanager
def fmu_file(path: Path) -> Iterator[Path]:
    """The file that `path` names, a copy of it where that leads into an .ssp. Raises FmuError, by `path`."""
    archive = next((folder for folder in path.parents if folder.suffix == SUFFIX and folder.is_file()), None)
    if archive is None:
        yield path
        return
    with temporary_folder("ssp") as folder:
        copy = folder / path.name
        try:
            with zipfile.ZipFile(archive) as packed:
                if reason := unpacked_error(packed):
                    raise FmuError(f"{archive}: {reason}")
                copy.write_bytes(packed.read(path.relative_to(archive).as_posix()))
        except (KeyError, *UNREADABLE) as error:
            cause = reason_of(error) if isinstance(error, OSError) else str(error)
            raise FmuError(f"{path}: cannot be read: {cause}") from error
        try:
            yield copy
        except FmuError as error:
            raise FmuError(str(error).replace(str(copy), str(path))) from error

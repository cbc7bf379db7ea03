"""The folder of a study on disk: what it is a study of, and a record of each print, added as soon as it has ended.

`records.jsonl` has a line for each print, in the order in which they ended; a line that a kill has cut short does not
count. Only the process that was started writes here, which holds the lock of the folder.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from inkloop import __version__
from inkloop.errors import ResultError
from inkloop.files import reason_of, replaced, write_text
from inkloop_lab.sweep.bundle import Bundle
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import INTERRUPTED, Record

STUDY_FILE, STATE_FILE, RECORDS_FILE = "study.toml", "study.json", "records.jsonl"
MAPS_FOLDER, RUNS_FOLDER = "maps", "prints"
SCHEMA_VERSION = 1


class Journal:
    """The records of a study's prints, in its folder. Raises ResultError where the folder is not this study's."""

    def __init__(self, folder: Path, study: Study, bundle: Bundle) -> None:
        self._folder, self._keeps_runs = folder, study.tables.keep.maps == "all"
        self._records: dict[tuple[int, int], Record] = {}
        try:
            if (folder / STATE_FILE).is_file():
                _check_same(folder, study, bundle)
            write_text(folder / STUDY_FILE, study.text)
            write_text(folder / STATE_FILE, json.dumps(_identity(study, bundle), indent=2) + "\n")
            self._file = self._opened(folder / RECORDS_FILE)
        except OSError as error:
            raise ResultError(f"{folder}: the study cannot be written there: {reason_of(error)}") from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    @property
    def records(self) -> Mapping[tuple[int, int], Record]:
        """The record of each print that has ended, by point and replicate; last surfaces are in files."""
        return self._records

    def add(self, record: Record) -> None:
        """Keep the record of a print; its run folder goes unless runs are kept. Raises ResultError."""
        if record.status == INTERRUPTED or record.key in self._records:
            return
        name = f"{record.point:05d}-{record.replicate:04d}"
        try:
            if record.height is not None:
                with replaced(self._folder / MAPS_FOLDER / f"{name}.npy") as partial, partial.open("wb") as file:
                    np.save(file, record.height)
            self._file.write(json.dumps(_plain(record)) + "\n")
            self._file.flush()
        except OSError as error:
            raise ResultError(f"{self._folder}: a record cannot be written: {reason_of(error)}; make room") from error
        self._records[record.key] = replace(record, height=None)
        if not self._keeps_runs:
            shutil.rmtree(self._folder / RUNS_FOLDER / name, ignore_errors=True)

    def height(self, record: Record) -> Any:
        """The last surface of a print (x, y) [m], None if none was kept. Raises ResultError."""
        path = self._folder / MAPS_FOLDER / f"{record.point:05d}-{record.replicate:04d}.npy"
        try:
            return np.load(path) if path.is_file() else None
        except (OSError, ValueError) as error:
            raise ResultError(f"{path}: cannot be read: {error}") from error

    def _opened(self, path: Path) -> IO[str]:
        """The file with the records at its end, without a line that was cut short."""
        whole = 0
        if path.is_file():
            content = path.read_bytes()
            whole = content.rfind(b"\n") + 1
            for line in content[:whole].splitlines():
                record = Record(**json.loads(line))
                self._records.setdefault(record.key, record)
        file = path.open("a", encoding="utf-8")
        file.truncate(whole)
        return file


def _plain(record: Record) -> dict[str, Any]:
    metrics = {name: float(value) for name, value in record.metrics.items()}
    found = {"point": record.point, "replicate": record.replicate, "status": record.status, "metrics": metrics}
    return {**found, "wall_s": record.wall_s, "error": record.error}


def _identity(study: Study, bundle: Bundle) -> dict[str, Any]:
    """What every print depends on, by the words of a message. More seeds or trials of the same study are no change."""
    optimise = study.tables.optimise
    points = [list(study.points()), [(key, repr(spread)) for key, spread in study.search.items()], study.first_seed]
    search = optimise and optimise.model_dump(exclude={"trials"})
    return {
        "schema_version": SCHEMA_VERSION,
        "inkloop": __version__,
        "study_file": str(study.path.resolve()),
        "sha256": {
            "the scenario or one of its files": bundle.sha256,
            "vary, sample or seeds.first": _sha256(points),
            "optimise": _sha256([search, study.tables.seeds.count] if optimise else None),
            "keep": _sha256(study.tables.keep.model_dump()),
        },
    }


def _check_same(folder: Path, study: Study, bundle: Bundle) -> None:
    """Raises ResultError where a folder holds another study than this one."""
    try:
        found = json.loads((folder / STATE_FILE).read_text(encoding="utf-8"))
        if found["schema_version"] != SCHEMA_VERSION:
            raise ResultError(f"{folder}: schema version is {found['schema_version']}; this inkloop reads 1")
        known, own = found["sha256"], _identity(study, bundle)["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise ResultError(f"{folder / STATE_FILE}: is no record of a study; begin the study in a new folder") from error
    if changed := [what for what in own if known.get(what) != own[what]]:
        raise ResultError(
            f"{folder}: was begun with another study: changed since then: {'; '.join(changed)}. Take the change back "
            f"({folder / STUDY_FILE} is the study as begun), or begin the study in a new folder"
        )


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()

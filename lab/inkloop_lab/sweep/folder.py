"""The folder of a study on disk: of which study it is, and a file for each print that has ended.

A print counts once its file is there, which is renamed into place when it is whole. Only the process that was started
writes here, which holds the lock of the folder.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from inkloop import __version__
from inkloop.errors import ResultError
from inkloop.files import reason_of, regular, replaced, write_text
from inkloop.results.study_folder import STUDY_STATE_FILE
from inkloop_lab.sweep.study import Study
from inkloop_lab.sweep.task import Bundle, Record, name_of

STUDY_FILE = "study.toml"
PRINTS_FOLDER, MAPS_FOLDER = "prints", "maps"
SCHEMA_VERSION = 2


class StudyFolder:
    """The records of a study's prints, in its folder. Raises ResultError where the folder is not this study's."""

    def __init__(self, folder: Path, study: Study, bundle: Bundle) -> None:
        self._folder, self._keeps_runs = folder, study.tables.keep.maps == "all"
        try:
            if (folder / STUDY_STATE_FILE).is_file():
                _check_same(folder, study, bundle)
            write_text(folder / STUDY_FILE, study.text)
            write_text(folder / STUDY_STATE_FILE, json.dumps(_identity(study, bundle), indent=2) + "\n")
            found = [_read(path) for path in sorted((folder / PRINTS_FOLDER).glob("*.json"))]
        except OSError as error:
            raise ResultError(f"{folder}: the study cannot be written there: {reason_of(error)}") from error
        self._records = {record.key: record for record in found}

    @property
    def records(self) -> Mapping[tuple[int, int], Record]:
        """The record of each print that has ended, by point and replicate; last surfaces are in files."""
        return self._records

    def add(self, record: Record) -> None:
        """Keep the record of a print; its run folder goes unless runs are kept. Raises ResultError."""
        try:
            if record.height is not None:
                with replaced(self._map_of(record)) as partial, partial.open("wb") as file:
                    np.save(file, record.height)
            write_text(self._folder / PRINTS_FOLDER / f"{name_of(record.key)}.json", json.dumps(_plain(record)) + "\n")
        except OSError as error:
            raise ResultError(f"{self._folder}: a record cannot be written: {reason_of(error)}; make room") from error
        self._records[record.key] = replace(record, height=None)
        if not self._keeps_runs:
            shutil.rmtree(self._folder / PRINTS_FOLDER / name_of(record.key), ignore_errors=True)

    def height(self, record: Record) -> Any:
        """The last surface of a print (x, y) [m], None if none was kept. Raises ResultError."""
        path = self._map_of(record)
        try:
            return np.load(path) if path.is_file() else None
        except (OSError, ValueError) as error:
            raise ResultError(f"{path}: cannot be read: {error}") from error

    def _map_of(self, record: Record) -> Path:
        return self._folder / MAPS_FOLDER / f"{name_of(record.key)}.npy"


def _read(path: Path) -> Record:
    try:
        return Record(**json.loads(regular(path).read_bytes()))
    except (ValueError, TypeError) as error:
        raise ResultError(f"{path}: is no record of a print ({error}); delete it to print again") from error


def _plain(record: Record) -> dict[str, Any]:
    metrics = {name: float(value) for name, value in record.metrics.items()}
    found = {"point": record.point, "replicate": record.replicate, "status": record.status, "metrics": metrics}
    return {**found, "wall_s": record.wall_s, "error": record.error}


def _identity(study: Study, bundle: Bundle) -> dict[str, Any]:
    """Inputs that every print depends on, by the words of a message. More seeds or trials are no change."""
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
        found = json.loads((folder / STUDY_STATE_FILE).read_text(encoding="utf-8"))
        if found["schema_version"] != SCHEMA_VERSION:
            raise ResultError(
                f"{folder}: schema version is {found['schema_version']}; this inkloop reads {SCHEMA_VERSION}; begin "
                "the study in a new folder"
            )
        known, own = found["sha256"], _identity(study, bundle)["sha256"]
    except (ValueError, KeyError, TypeError) as error:
        raise ResultError(
            f"{folder / STUDY_STATE_FILE}: is no record of a study; begin the study in a new folder"
        ) from error
    if changed := [what for what in own if known.get(what) != own[what]]:
        raise ResultError(
            f"{folder}: was begun with another study: changed since then: {'; '.join(changed)}. Take the change back "
            f"({folder / STUDY_FILE} is the study as begun), or begin the study in a new folder"
        )


def _sha256(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()

"""A finished run: labelled arrays with units, and the record of how they came about.

A run folder holds `result.nc` (the arrays), `scenario.toml` (the file as run) and `run.json` (versions, seed, hashes,
wall times, stop reason). The latter two are there from the start of the run.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from inkloop.component import Component
from inkloop.errors import ResultError
from inkloop.files import is_full, reason_of, regular, replaced, sync_folder, write_text
from inkloop.results import netcdf
from inkloop.results.attributes import CONVENTIONS
from inkloop.results.layer_maps import LayerMaps
from inkloop.results.lock import writer_of
from inkloop.results.metrics import masked_error
from inkloop.results.study_folder import study_in
from inkloop.tables.html import html_table
from inkloop.units import UM_PER_M

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["RESULT_FILE", "RUN_FILE", "STOPPED", "UNFINISHED", "Result", "read_record"]

SCHEMA_VERSION = 1
RESULT_FILE, RUN_FILE, SCENARIO_FILE = "result.nc", "run.json", "scenario.toml"
READ_AT_ONCE = 1 << 26
"""Bytes of the arrays of a result up to which all of them are read into memory."""
COMPARE_FOLDER = "compare"
"""Folder of a run folder that holds its comparison runs."""
STOPPED = "stopped"
"""Stop reason of a run whose controller has ended it: the scans do not show what was printed."""
UNFINISHED = ("running", "interrupted", "failed", STOPPED)
"""Stop reasons of runs that `inkloop resume` can continue."""
_LIBRARIES = ("inkloop", "casadi", "fmpy", "numpy", "xarray")


@dataclass(frozen=True, eq=False)
class Result:
    """`dataset`: dims layer, x, y; `run`: what stands in run.json."""

    dataset: xr.Dataset
    run: Mapping[str, Any]

    @classmethod
    def of(
        cls,
        dataset: xr.Dataset,
        *,
        title: str,
        label: str,
        scenario_text: str,
        seed: int,
        stop_reason: str,
        wall_s: Mapping[str, float],
        components: Mapping[str, Component],
        notes: Mapping[str, Any] | None = None,
    ) -> Result:
        """A result from what a recorder holds; `label` names the run where several stand side by side.

        notes: further entries of run.json.
        """
        common = {"schema_version": SCHEMA_VERSION, "title": title, "label": label, "seed": seed}
        common |= {"stop_reason": stop_reason}
        source = f"inkloop {_version('inkloop')}"
        attributes = {"Conventions": CONVENTIONS, **common, "scenario": scenario_text, "source": source}
        hashes = {"scenario": _sha256(scenario_text)}
        hashes |= {name: part.sha256 for name, part in components.items() if hasattr(part, "sha256")}
        run = {
            **common,
            "versions": {"python": platform.python_version(), **{name: _version(name) for name in _LIBRARIES}},
            "platform": platform.platform(),
            "sha256": hashes,
            "wall_s": dict(wall_s),
            **(notes or {}),
        }
        return cls(dataset.assign_attrs(attributes), run)

    @property
    def scenario_text(self) -> str:
        """The scenario as run, overrides included."""
        return str(self.dataset.attrs["scenario"])

    @property
    def stop_reason(self) -> str:
        """The stop reason of the run, see `Master.run`."""
        return str(self.dataset.attrs["stop_reason"])

    @property
    def wall_s(self) -> float:
        """Wall time of the whole run [s]."""
        return float(self.run["wall_s"]["total"])

    @property
    def final_height(self) -> xr.DataArray:
        """Surface after the last layer (x, y) [m]."""
        return self.dataset["height"][-1]

    @property
    def error_map(self) -> xr.DataArray:
        """Target minus final height over the part (x, y) [m], NaN elsewhere."""
        return (self.dataset["target_height"] - self.final_height).where(self.dataset["mask"])

    def metrics(self) -> dict[str, float]:
        """Errors of the last surface over the part [m], layers, droplets, `spill`: ink beside it [m3], mismatch."""
        height, target, mask = (a.values for a in (self.final_height, self.dataset.target_height, self.dataset.mask))
        error = masked_error(height, target, mask)
        beside = np.nansum((height - self.dataset["height"][0].values)[~mask.astype(bool)])
        figures = {name: getattr(error, name) for name in ("mean_error", "mae", "rms", "std", "min", "max")}
        figures |= {"layers": float(self.dataset.sizes["layer"] - 1), "droplets": self._droplets()}
        figures["spill"] = float(beside) * float(self.dataset.attrs["pitch"]) ** 2
        return figures | ({"mismatch": float(self.dataset.mismatch)} if "mismatch" in self.dataset else {})

    def _repr_html_(self) -> str:
        """Its figures, for notebooks."""
        figures, dims = self.metrics(), self.dataset.sizes
        rows = {f"{name} [µm]": f"{figures[name] * UM_PER_M:.3g}" for name in ("mean_error", "mae", "rms", "std")}
        rows |= {name: f"{figures[name]:.0f}" for name in ("layers", "droplets")}
        rows |= {"mismatch": f"{figures['mismatch']:.1%}"} if "mismatch" in figures else {}
        rows |= {"ended": self.stop_reason, "seed": str(self.run["seed"]), "cells": f"{dims['x']} x {dims['y']}"}
        return html_table(f"{self.run['title']} ({self.run['label']})", rows)

    @staticmethod
    def begin(folder: Path, scenario_text: str, notes: Mapping[str, Any]) -> None:
        """Write the files of a run folder that exist during the run. Raises ResultError."""
        run = {
            "schema_version": SCHEMA_VERSION,
            "stop_reason": "running",
            "process": os.getpid(),
            "scenario_sha256": _sha256(scenario_text),
        }
        try:
            folder.mkdir(parents=True, exist_ok=True)
            sync_folder(folder.parent)
            write_text(folder / SCENARIO_FILE, scenario_text, durable=True)
            write_text(folder / RUN_FILE, json.dumps(run | dict(notes), indent=2) + "\n", durable=True)
        except OSError as error:
            raise ResultError(f"{folder}: the run cannot be written there: {reason_of(error)}") from error

    def save(self, folder: Path, maps: LayerMaps | None = None) -> None:
        """Write the run folder's files, each whole or not at all. Raises ResultError.

        maps: those by layer, where `dataset` does not hold them.
        """
        with saving(folder):
            folder.mkdir(parents=True, exist_ok=True)
            with replaced(folder / RESULT_FILE) as partial:
                if maps:
                    maps.write(partial, self.dataset)
                else:
                    netcdf.write(partial, self.dataset)
            write_text(folder / SCENARIO_FILE, self.scenario_text)
            write_text(folder / RUN_FILE, json.dumps(self.run, indent=2) + "\n")

    @classmethod
    def load(cls, folder: Path) -> Result:
        """Read a run folder; maps of a large run are read when they are used, and have to be kept until then.

        Raises ResultError where it is none, of another schema, or of a run that has not ended.
        """
        folder = Path(folder)
        run = read_record(folder)
        if run.get("stop_reason") == "running":
            raise ResultError(f"{folder}: {_progress_of(folder, run)}")
        try:
            dataset = netcdf.read(folder / RESULT_FILE, READ_AT_ONCE)
        except FileNotFoundError as error:
            raise ResultError(f"{folder}: holds no {RESULT_FILE}; `inkloop resume {folder}` continues it") from error
        except (OSError, ValueError, KeyError) as error:
            raise ResultError(f"{folder}: cannot be read: {error}") from error
        _check_schema(folder, dataset.attrs.get("schema_version"))
        return cls(dataset, run)

    def _droplets(self) -> float:
        """Droplets that landed, as the printer counted them, else as they were commanded."""
        counts = [self.dataset[name] for name in ("droplets_a", "droplets_b") if name in self.dataset]
        if counts:
            return float(sum(int(count[-1]) for count in counts))
        if "pattern" not in self.dataset:
            return float("nan")
        return float(sum(np.count_nonzero(pattern) for pattern in self.dataset["pattern"]))


@contextmanager
def saving(folder: Path) -> Iterator[None]:
    """Guard of a block that writes a result; raises ResultError where there is no room or no file."""
    try:
        yield
    except (OSError, MemoryError) as error:
        has_no_room = isinstance(error, MemoryError) or is_full(error)
        advice = f"; make room, then continue with `inkloop resume {folder}`" if has_no_room else ""
        raise ResultError(f"{folder}: the run cannot be saved: {reason_of(error)}{advice}") from error


def read_record(folder: Path) -> dict[str, Any]:
    """The run.json of a run folder, finished or not. Raises ResultError where it is none, or of another schema."""
    try:
        record = json.loads(regular(folder / RUN_FILE).read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError) as error:
        found = study_in(folder) or f"holds no {RUN_FILE}; name a folder that `inkloop run` has made"
        raise ResultError(f"{folder}: {found}") from error
    except (OSError, ValueError, RecursionError) as error:
        raise ResultError(f"{folder}: cannot be read: {error}") from error
    if not isinstance(record, dict):
        raise ResultError(f"{folder / RUN_FILE}: is no record of a run; name a folder that `inkloop run` has made")
    _check_schema(folder, record.get("schema_version"))
    return record


def is_unchanged(folder: Path, record: Mapping[str, Any]) -> bool:
    """Whether the scenario in a run folder is the one that its record was begun with."""
    expected = record.get("scenario_sha256") or record.get("sha256", {}).get("scenario")
    return bool(expected == _sha256(regular(folder / SCENARIO_FILE).read_text(encoding="utf-8")))


def _progress_of(folder: Path, record: Mapping[str, Any]) -> str:
    """Progress of a run that has not ended, and whether its process still prints."""
    from inkloop.results import checkpoint

    state = checkpoint.last(folder)
    done = "no layer is finished yet" if state is None else f"layer {state.layer} is finished"
    owners = (folder, folder.parent.parent) if folder.parent.name == COMPARE_FOLDER else (folder,)
    # to look at the lock of one's own process would release it
    is_own = record.get("process") == os.getpid()
    if owner := "this process" if is_own else next(filter(None, map(writer_of, owners)), ""):
        return f"being printed by {owner}; {done}. Its result can be read when it has ended"
    return f"was not finished, its process has ended; {done}. Continue with `inkloop resume {folder}`"


def _check_schema(folder: Path, found: object) -> None:
    if found != SCHEMA_VERSION:
        raise ResultError(f"{folder}: schema version is {found}; this inkloop reads {SCHEMA_VERSION}; run it again")


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
